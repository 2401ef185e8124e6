#include "falloff.h"

#include "gloss.h"

#include <algorithm>
#include <cmath>

namespace nusselt {

using namespace kernels;

namespace {

size_t mask_set_bytes(const Frame& frame) {
    return size_t(lanes) * mask_bytes(frame.tables->layout);
}

FadingJobs fading_job_list(Worker& worker) {
    const size_t stride = worker.inverse.size() / 3;
    uint32_t* const base = worker.fading_jobs.data();
    float* const inverse = worker.inverse.data();
    return {{{base, base + stride, base + 2 * stride}, base + 3 * stride, 0},
            {inverse, inverse + stride, inverse + 2 * stride}};
}

const float* points_of(const Frame& frame, uint32_t cluster) {
    return frame.points.data() + 4 * size_t(frame.meshes[frame.cluster_mesh[cluster]].first_point);
}

// Whether all of a cluster is so near to all receivers that it hides as a whole.
bool is_before_fade(const Frame& frame, const Batch& batch, const ClusterView& view) {
    float square = 0;
    for (uint32_t k = 0; k < 3; ++k) {
        const float d = view.centre[k] - batch.bounds.centre[k];
        square += d * d;
    }
    return 1.0001f * (std::sqrt(square) + view.radius + batch.bounds.radius) < frame.fade.from;
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

Fade make_fade(const Falloff& falloff, float scale) {
    // Nothing in a frame is as far; a scale that small or large leaves no infinity.
    constexpr float far = 1e6f, steepest = 1e30f;
    Fade fade{};
    fade.from = std::min(falloff.from * scale, far);
    fade.to = std::min(falloff.to * scale, far);
    fade.steepness = std::min(1 / (fade.to - fade.from), steepest);
    return fade;
}

void draw_fading(const Frame& frame, const Batch& batch, uint32_t selected, Worker& worker, JobList& jobs,
                 StageClock& clock) {
    const Tables& tables = *frame.tables;
    FadingJobs fading = fading_job_list(worker);
    FadingParts parts{worker.parts.data(), worker.touched.data()};
    const auto flush = [&] {
        clock.lap(transform_stage);
        frame.kernels->run_jobs(tables, jobs, worker.masks.data());
        frame.fading_kernels->run_jobs(tables, frame.fade_directions, frame.fade, fading, worker.masks.data(),
                                       parts);
        clock.lap(raster_stage);
    };
    // What hides as a whole first: samples that it covers are not asked for their part.
    uint32_t left = 0;
    for (uint32_t i = 0; i < selected; ++i) {
        const uint32_t c = worker.selected[i];
        if (!is_before_fade(frame, batch, frame.views[c])) {
            worker.selected[left++] = c;
            continue;
        }
        frame.kernels->cluster_jobs(batch, frame.views[c], points_of(frame, c), tables.layout, tables.horizon,
                                    worker.scratch[0], jobs, worker.tally.counters);
        if (jobs.count >= job_flush) flush();
    }
    for (uint32_t i = 0; i < left; ++i) {
        const uint32_t c = worker.selected[i];
        frame.kernels->fading_cluster_jobs(batch, frame.views[c], points_of(frame, c), tables.layout,
                                           tables.horizon, frame.fade, worker.scratch[0], jobs, fading,
                                           worker.tally.counters);
        if (std::max(jobs.count, fading.list.count) >= job_flush) flush();
    }
    flush();
}

void integrate_fading(const Frame& frame, const Batch& batch, uint32_t order, Worker& worker) {
    const Tables& tables = *frame.tables;
    const size_t bytes = mask_set_bytes(frame);
    uint8_t* const masks = worker.masks.data();
    uint8_t* digits[fade_digits];
    for (uint32_t digit = 0; digit < fade_digits; ++digit)
        digits[digit] = masks + (1 + digit) * bytes;
    FadingParts parts{worker.parts.data(), worker.touched.data()};
    const uint32_t in_part = frame.fading_kernels->split(tables.layout, parts, masks, digits) & batch.valid;
    frame.kernels->integrate(tables, masks, batch.valid, false, order, worker.local, worker.tally.counters);
    if (!in_part) return;
    alignas(64) float local[25][lanes];
    float part = 1;
    for (const uint8_t* digit : digits) {
        part *= 0.5f;
        frame.kernels->integrate(tables, digit, in_part, false, order, local, worker.tally.counters);
        for (uint32_t term = 0; term < order * order; ++term) {
            const float open = float(tables.total[term]) * tables.scale[term];
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                const float hidden = in_part >> lane & 1 ? open - local[term][lane] : 0.0f;
                worker.local[term][lane] -= part * hidden;
            }
        }
        for (size_t i = 0; i < bytes; ++i)
            masks[i] = uint8_t(masks[i] | digit[i]);
    }
}

} // namespace nusselt
