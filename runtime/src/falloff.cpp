#include "falloff.h"

#include "gloss.h"

#include "kernels/prepare.h"
#include "kernels/scalar.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

struct Point {
    float x, y;
};

// A disc as a regular polygon of the same area.
constexpr uint32_t sides = 12;
constexpr float over_radius = 1.0233267f; // sqrt(pi / 3)
constexpr Point corner_of[sides] = {
    {1, 0},  {0.8660254f, 0.5f},   {0.5f, 0.8660254f},   {0, 1},  {-0.5f, 0.8660254f}, {-0.8660254f, 0.5f},
    {-1, 0}, {-0.8660254f, -0.5f}, {-0.5f, -0.8660254f}, {0, -1}, {0.5f, -0.8660254f}, {0.8660254f, -0.5f}};
constexpr uint32_t most_corners = 3 + sides;

// What lies inside one side of the polygon, left of it.
uint32_t clip_side(const Point* in, uint32_t count, const Point& a, const Point& b, Point* out) {
    const auto inside = [&](const Point& p) { return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x); };
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; ++i) {
        const Point &p = in[i], &q = in[(i + 1) % count];
        const float at = inside(p), next = inside(q);
        if (at >= 0) out[kept++] = p;
        if ((at >= 0) == (next >= 0)) continue;
        const float t = at / (at - next);
        out[kept++] = {p.x + (q.x - p.x) * t, p.y + (q.y - p.y) * t};
    }
    return kept;
}

// The triangle within the disc about the origin; returns its corners.
uint32_t clip_disc(const Point triangle[3], float radius, Point out[most_corners]) {
    Point buffer[most_corners];
    std::copy(triangle, triangle + 3, out);
    uint32_t count = 3;
    const float r = radius * over_radius;
    for (uint32_t k = 0; k < sides && count > 0; ++k) {
        const Point &a = corner_of[k], &b = corner_of[(k + 1) % sides];
        count = clip_side(out, count, {a.x * r, a.y * r}, {b.x * r, b.y * r}, buffer);
        std::copy(buffer, buffer + count, out);
    }
    return count;
}

// One triangle as a lane's receiver has it in a ball: nothing, all of it, or a polygon.
struct Piece {
    uint32_t count = 0; // corners
    float corner[most_corners][3];
};

// `all`: whether the ball holds the whole triangle.
void clip_ball(const float* const corner[3], const float receiver[3], float radius, Piece& piece, bool& all) {
    float d[3][3], farthest = 0;
    for (uint32_t k = 0; k < 3; ++k) {
        for (uint32_t axis = 0; axis < 3; ++axis)
            d[k][axis] = corner[k][axis] - receiver[axis];
        farthest = std::max(farthest, d[k][0] * d[k][0] + d[k][1] * d[k][1] + d[k][2] * d[k][2]);
    }
    piece.count = 0;
    all = farthest < radius * radius;
    if (all) {
        piece.count = 3;
        for (uint32_t k = 0; k < 3; ++k)
            std::copy(corner[k], corner[k] + 3, piece.corner[k]);
        return;
    }
    float u[3], v[3], n[3];
    for (uint32_t axis = 0; axis < 3; ++axis) {
        u[axis] = d[1][axis] - d[0][axis];
        v[axis] = d[2][axis] - d[0][axis];
    }
    n[0] = u[1] * v[2] - u[2] * v[1];
    n[1] = u[2] * v[0] - u[0] * v[2];
    n[2] = u[0] * v[1] - u[1] * v[0];
    const float area = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    const float length = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    if (!(area > 0 && length > 0)) return;
    float across[3]; // n x u, in the plane
    for (uint32_t axis = 0; axis < 3; ++axis) {
        n[axis] /= area;
        u[axis] /= length;
    }
    across[0] = n[1] * u[2] - n[2] * u[1];
    across[1] = n[2] * u[0] - n[0] * u[2];
    across[2] = n[0] * u[1] - n[1] * u[0];
    const float height = n[0] * d[0][0] + n[1] * d[0][1] + n[2] * d[0][2];
    const float square = radius * radius - height * height;
    if (!(square > 0)) return;
    Point flat[3], clipped[most_corners];
    for (uint32_t k = 0; k < 3; ++k)
        flat[k] = {u[0] * d[k][0] + u[1] * d[k][1] + u[2] * d[k][2],
                   across[0] * d[k][0] + across[1] * d[k][1] + across[2] * d[k][2]};
    piece.count = clip_disc(flat, std::sqrt(square), clipped);
    for (uint32_t i = 0; i < piece.count; ++i) {
        for (uint32_t axis = 0; axis < 3; ++axis)
            piece.corner[i][axis] =
                receiver[axis] + n[axis] * height + u[axis] * clipped[i].x + across[axis] * clipped[i].y;
    }
}

uint32_t mask_set_bytes(const Frame& frame) {
    return lanes * mask_bytes(frame.tables->layout);
}

// The jobs from `first` on belong to a shell.
void move_jobs(const Frame& frame, JobList& jobs, uint32_t first, uint32_t shell) {
    for (uint32_t j = first; j < jobs.count; ++j)
        jobs.destination[j] += shell * mask_set_bytes(frame);
}

void flush(const Frame& frame, Worker& worker, JobList& jobs) {
    if (jobs.count >= job_flush) frame.kernels->run_jobs(*frame.tables, jobs, worker.masks.data());
}

// The receivers for which the cluster's level stands for the triangle, as kernels::ClusterJobs decides it.
uint32_t lanes_in_band(const Batch& batch, const ClusterView& view, uint32_t triangle,
                       const float* const corner[3]) {
    const uint32_t slots = triangle_slots(view.triangle_count);
    const float* plane = view.bounds + triangle;
    const float farthest = triangle_reach(view, triangle);
    uint32_t in = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        float height = 0;
        for (uint32_t axis = 0; axis < 3; ++axis)
            height += plane[axis * slots] * batch.position[axis][lane];
        if (std::fabs(height - plane[3 * slots]) <= view.clearance) continue;
        uint32_t near = 0, far = 0;
        for (uint32_t k = 0; k < 3; ++k) {
            float square = 0;
            for (uint32_t axis = 0; axis < 3; ++axis) {
                const float d = corner[k][axis] - batch.position[axis][lane];
                square += d * d;
            }
            near += square < farthest * farthest;
            far += square >= view.nearest * view.nearest;
        }
        in |= uint32_t(near > 0 && far >= (view.two_sided ? 2u : 1u)) << lane;
    }
    return in & batch.valid;
}

// A triangle that is large beside the shells: cut at each of them.
void raster_large(const Frame& frame, const Batch& batch, const ClusterView& view, uint32_t triangle,
                  const float* const corner[3], Worker& worker, JobList& jobs) {
    uint32_t left = lanes_in_band(batch, view, triangle, corner);
    for (uint32_t shell = 0; shell < frame.shells.count && left; ++shell) {
        const float radius = frame.shells.far[shell] * frame.scale;
        Piece pieces[lanes];
        uint32_t most = 0;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            if (!(left >> lane & 1)) continue;
            const float receiver[3] = {batch.position[0][lane], batch.position[1][lane],
                                       batch.position[2][lane]};
            bool all = false;
            clip_ball(corner, receiver, radius, pieces[lane], all);
            most = std::max(most, pieces[lane].count);
            if (all) left &= ~(1u << lane); // in every shell farther out as well
        }
        for (uint32_t i = 2; i < most; ++i) {
            alignas(64) float corners[3][3][lanes] = {};
            uint32_t active = 0;
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                if (i >= pieces[lane].count) continue;
                active |= 1u << lane;
                const float* const fan[3] = {pieces[lane].corner[0], pieces[lane].corner[i - 1],
                                             pieces[lane].corner[i]};
                for (uint32_t k = 0; k < 3; ++k) {
                    for (uint32_t axis = 0; axis < 3; ++axis)
                        corners[k][axis][lane] = fan[k][axis];
                }
            }
            const uint32_t first = jobs.count;
            frame.kernels->triangle_jobs(batch, corners, active, view.two_sided ? active : 0,
                                         frame.tables->layout, frame.tables->horizon, jobs,
                                         worker.tally.counters);
            move_jobs(frame, jobs, first, shell);
            flush(frame, worker, jobs);
        }
    }
}

} // namespace

Status check_falloff(const FrameDesc& desc) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    const Falloff& f = desc.falloff;
    if (f.from == 0 && f.to == 0) return {};
    if (!(f.from >= 0 && f.to > 0 && f.from <= f.to && f.to <= FLT_MAX))
        return bad(
            "no frame started: the falloff's distances are negative, not finite or out of order; give 0 <= "
            "from <= to, or 0 for both");
    if (desc.quality == Quality::paper)
        return bad(
            "no frame started: quality paper has no falloff, it is the method as published; use another");
    if (desc.history.generation != 0)
        return bad("no frame started: a falloff with a history, which does not know it; give one of the two");
    const auto any_from_masks = [](const FrameMesh& m) {
        return std::any_of(m.outputs, m.outputs + m.output_count,
                           [&](const Output& output) { return is_from_masks(output.kind, m.gloss); });
    };
    for (uint32_t i = 0; i < desc.mesh_count; ++i) {
        if (any_from_masks(desc.meshes[i]) || any_from_masks(turned_over(desc.meshes[i])))
            return bad(
                "no frame started: glossy and direct light have no falloff, which only transfer vectors "
                "and what is made of them know; ask for one of the two");
    }
    return {};
}

Shells make_shells(const Falloff& falloff) {
    Shells shells;
    if (!(falloff.to > 0)) return shells;
    const uint32_t fading = falloff.to > falloff.from ? most_shells - 1 : 0;
    shells.count = 1 + fading;
    shells.far[0] = falloff.from;
    shells.weight[0] = 1;
    for (uint32_t k = 1; k <= fading; ++k) {
        // Smoothstep at the middle of the shell.
        const float t = (float(k) - 0.5f) / float(fading);
        shells.far[k] = falloff.from + (falloff.to - falloff.from) * (float(k) / float(fading));
        shells.weight[k] = 1 - t * t * (3 - 2 * t);
    }
    return shells;
}

void raster_shells(const Frame& frame, const Batch& batch, uint32_t selected, Worker& worker, JobList& jobs,
                   StageClock& clock) {
    const Shells& shells = frame.shells;
    // Triangles that are larger are cut: they would leave a shell by more than it is thick, or a ball by more
    // than a seventh of its radius.
    float thickness = 0.15f * shells.far[shells.count - 1];
    if (shells.count > 1) thickness = std::min(thickness, shells.far[1] - shells.far[0]);
    thickness *= frame.scale;
    for (uint32_t i = 0; i < selected; ++i) {
        const uint32_t c = worker.selected[i];
        const float* points =
            frame.points.data() + 4 * size_t(frame.meshes[frame.cluster_mesh[c]].first_point);
        ClusterView view = frame.views[c];
        float square = 0;
        for (uint32_t k = 0; k < 3; ++k) {
            const float d = view.centre[k] - batch.bounds.centre[k];
            square += d * d;
        }
        const float distance = std::sqrt(square), around = (view.radius + batch.bounds.radius) * 1.00001f;
        if (distance - around > frame.scale * shells.far[shells.count - 1]) continue;
        if (frame.triangle_radius.data()[c] > thickness) {
            for (uint32_t t = 0; t < view.triangle_count; ++t) {
                const float* corner[3];
                for (uint32_t k = 0; k < 3; ++k)
                    corner[k] = points + 4 * size_t(view.vertices[view.triangles[8 * t + k]]);
                raster_large(frame, batch, view, t, corner, worker, jobs);
            }
            continue;
        }
        for (uint32_t shell = 0; shell < shells.count; ++shell) {
            const float near = shell > 0 ? frame.scale * shells.far[shell - 1] : 0.0f,
                        far = frame.scale * shells.far[shell];
            if (distance + around < near || distance - around >= far) continue;
            view.nearest = std::max(frame.views[c].nearest, near);
            view.farthest = std::min(frame.views[c].farthest, far);
            view.outermost = far;
            if (view.nearest >= std::max(view.farthest, std::min(2 * frame.triangle_radius.data()[c], far)))
                continue;
            const uint32_t first = jobs.count;
            frame.kernels->cluster_jobs(batch, view, points, frame.tables->layout, frame.tables->horizon,
                                        worker.scratch[0], jobs, worker.tally.counters);
            move_jobs(frame, jobs, first, shell);
            if (jobs.count < job_flush) continue;
            clock.lap(transform_stage);
            flush(frame, worker, jobs);
            clock.lap(raster_stage);
        }
    }
    clock.lap(transform_stage);
    frame.kernels->run_jobs(*frame.tables, jobs, worker.masks.data());
}

void integrate_shells(const Frame& frame, const Batch& batch, uint32_t order, Worker& worker) {
    const Shells& shells = frame.shells;
    const uint32_t bytes = mask_set_bytes(frame);
    alignas(64) float local[25][lanes];
    std::memset(worker.local, 0, sizeof(worker.local));
    uint8_t* mask = worker.masks.data();
    for (uint32_t shell = 0; shell < shells.count; ++shell, mask += bytes) {
        for (uint32_t i = 0; shell > 0 && i < bytes; ++i)
            mask[i] = uint8_t(mask[i] | mask[int64_t(i) - bytes]);
        const float next = shell + 1 < shells.count ? shells.weight[shell + 1] : 0.0f;
        const float weight = shells.weight[shell] - next;
        frame.kernels->integrate(*frame.tables, mask, batch.valid, false, order, local,
                                 worker.tally.counters);
        for (uint32_t term = 0; term < 25; ++term) {
            for (uint32_t lane = 0; lane < lanes; ++lane)
                worker.local[term][lane] += weight * local[term][lane];
        }
    }
    std::memcpy(worker.masks.data(), mask - bytes, bytes);
}

} // namespace nusselt
