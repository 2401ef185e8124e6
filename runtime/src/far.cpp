#include "far.h"

#include "batches.h"
#include "gloss.h"
#include "objects.h"

#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

#include "kernels/sh_formulas.inl"

using namespace kernels;

struct Double {
    double operator()(double value) const { return value; }
};

constexpr uint32_t most_blocks = 256; // of the finest masks
constexpr double pi = 3.14159265358979323846;

// A batch whose first six receivers stand at one point and look along the axes.
void face_batch(const Kernels& k, const float centre[3], Batch& batch) {
    alignas(64) float normal[3][lanes] = {};
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        for (uint32_t i = 0; i < 3; ++i)
            batch.position[i][lane] = centre[i];
        normal[lane / 2 % 3][lane] = lane % 2 ? -1.0f : 1.0f;
    }
    batch.valid = (1u << far_faces) - 1;
    k.prepare_batch(batch, normal);
}

// Draws meshes as proxies into worker.masks, which look along the axes from a point.
void draw_around(const Frame& frame, const float centre[3], const uint32_t* meshes, uint32_t count,
                 Worker& worker) {
    const Kernels& k = *frame.kernels;
    const Tables& tables = *frame.tables;
    Batch& batch = worker.far_batch;
    face_batch(k, centre, batch);
    JobList jobs = job_list(worker);
    uint32_t selected = 0;
    for (uint32_t i = 0; i < count; ++i)
        selected += select_proxies(frame, meshes[i], batch.bounds, worker.selected.data() + selected, worker);
    worker.tally.clusters_rasterized += selected;
    for (uint32_t i = 0; i < selected; ++i) {
        const uint32_t c = worker.selected[i];
        const float* points =
            frame.points.data() + 4 * size_t(frame.meshes[frame.cluster_mesh[c]].first_point);
        k.cluster_jobs(batch, frame.views[c], points, tables.layout, tables.horizon, worker.scratch[0], jobs,
                       worker.tally.counters);
        if (jobs.count >= job_flush) k.run_jobs(tables, jobs, worker.masks.data());
    }
    k.run_jobs(tables, jobs, worker.masks.data());
}

// What is left of transfer vectors where worker.masks are hidden.
void make_matrix(const Frame& frame, const Worker& worker, float matrix[25][25]) {
    const MaskLayout& layout = frame.tables->layout;
    const uint32_t blocks = mask_blocks(layout);
    alignas(64) float hidden[product_stride] = {};
    uint8_t counts[most_blocks];
    for (uint32_t face = 0; face < far_faces; ++face) {
        frame.kernels->downsample(worker.masks.data() + size_t(face) * mask_bytes(layout), blocks, counts);
        frame.light_kernels->add_hidden(frame.far_table + size_t(face) * blocks * product_stride, counts,
                                        blocks, hidden);
    }
    for (uint32_t i = 0, at = 0; i < 25; ++i) {
        for (uint32_t j = i; j < 25; ++j, ++at)
            matrix[i][j] = matrix[j][i] = (i == j ? 1.0f : 0.0f) - hidden[at];
    }
}

} // namespace

size_t far_table_size(const MaskLayout& layout) {
    return size_t(far_faces) * mask_blocks(layout) * product_stride;
}

void build_far_table(const MaskLayout& layout, float* table) {
    Batch batch{};
    const float centre[3] = {};
    face_batch(*kernels_for(Set::scalar), centre, batch);
    std::memset(table, 0, far_table_size(layout) * sizeof(float));
    // Bits have the same part of the disk, pi / bits, and more of the sphere the lower they lie. All together
    // they are the sphere.
    double sphere = 0, sums[product_entries];
    for (int pass = 0; pass < 2; ++pass) {
        for (uint32_t face = 0; face < far_faces; ++face) {
            for (uint32_t block = 0; block < mask_blocks(layout); ++block) {
                std::memset(sums, 0, sizeof(sums));
                for (uint32_t bit = block * 16; bit < block * 16 + 16; ++bit) {
                    double local[3], d[3], basis[25];
                    if (!sample_direction(layout, bit, local)) continue;
                    if (std::fabs(local[0]) > local[2] || std::fabs(local[1]) > local[2]) continue;
                    const double area = pi / mask_bits(layout) / local[2];
                    if (pass == 0) {
                        sphere += area;
                        continue;
                    }
                    for (uint32_t i = 0; i < 3; ++i)
                        d[i] = local[0] * double(batch.axis[0][i][face]) +
                               local[1] * double(batch.axis[1][i][face]) +
                               local[2] * double(batch.axis[2][i][face]);
                    sh_basis(Double(), d[0], d[1], d[2], basis);
                    const double weight = area * (4 * pi / sphere) / 16; // of a sixteenth of the block
                    for (uint32_t i = 0, at = 0; i < 25; ++i) {
                        for (uint32_t j = i; j < 25; ++j)
                            sums[at++] += weight * basis[i] * basis[j];
                    }
                }
                float* out = table + (size_t(face) * mask_blocks(layout) + block) * product_stride;
                for (uint32_t at = 0; pass == 1 && at < product_entries; ++at)
                    out[at] = static_cast<float>(sums[at]);
            }
        }
    }
}

bool may_look_far(const Frame& frame, const MeshSlice& slice) {
    if (!frame.proxies || frame.has_history || frame.fades || slice.in.masks.data) return false;
    for (uint32_t k = 0; k < slice.in.output_count; ++k) {
        if (frame.outputs[slice.first_output + k].encoding.quantity >= Quantity::glossy) return false;
    }
    return true;
}

void look_farther(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    Worker& worker = frame.workers[slot];
    const size_t bytes = far_faces * size_t(mask_bytes(frame.tables->layout));
    StageClock clock(worker.tally);
    for (uint32_t m = begin; m < end; ++m) {
        FarView& view = frame.far_views[m];
        const uint32_t count = view.wanted ? list_farther(frame, m, worker.far_meshes.data()) : 0;
        view.empty = count == 0;
        if (view.empty) continue;
        std::memset(worker.masks.data(), 0, bytes);
        draw_around(frame, middle_of(frame, m).centre, worker.far_meshes.data(), count, worker);
        make_matrix(frame, worker, view.matrix);
        std::memcpy(view.masks, worker.masks.data(), bytes);
    }
    clock.lap(cull_stage);
}

void look_far(const Frame& frame, const MeshSlice& slice, const ReceiverBounds& receivers, Worker& worker) {
    const FarView& view = frame.far_views[slice.body];
    const bool empty = !worker.has_far_view || view.empty;
    if (worker.far_count == 0) {
        worker.far_matrix = empty ? nullptr : view.matrix;
        return;
    }
    const size_t bytes = far_faces * size_t(mask_bytes(frame.tables->layout));
    if (empty) {
        std::memset(worker.masks.data(), 0, bytes);
    } else {
        std::memcpy(worker.masks.data(), view.masks, bytes);
    }
    draw_around(frame, receivers.centre, worker.far_meshes.data(), worker.far_count, worker);
    make_matrix(frame, worker, worker.own_matrix);
    worker.far_matrix = worker.own_matrix;
}

void multiply_far(const Frame& frame, Worker& worker) {
    alignas(64) float product[25][lanes];
    frame.light_kernels->multiply_transfer(worker.far_matrix, worker.turned, product);
    std::memcpy(worker.turned, product, sizeof(product));
}

} // namespace nusselt
