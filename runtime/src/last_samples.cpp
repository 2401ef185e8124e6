#include "last_samples.h"

#include "kernels/last_samples.h"
#include "visible_set.h"

#include <cstring>

namespace nusselt {

namespace {

using namespace kernels;

bool is_below_fan(const Frame& frame, const MeshSlice& slice, uint32_t receiver, const Batch& batch,
                  uint32_t lane, const Sample& sample) {
    if (slice.in.receive_only) return false;
    const MeshData& mesh = *slice.mesh;
    const float* points = frame.points.data() + 4 * size_t(slice.first_point);
    const uint32_t w = mesh.weld[receiver];
    for (uint32_t i = mesh.fan_begin[w]; i < mesh.fan_begin[w + 1]; ++i) {
        const uint32_t* const arc = mesh.fan.data() + 2 * size_t(i);
        if (hides_below(batch, lane, points + 4 * size_t(arc[0]), points + 4 * size_t(arc[1]), sample))
            return true;
    }
    return false;
}

constexpr uint32_t no_cluster = ~0u;

// The first of the selected clusters that hides the sample.
uint32_t hiding_cluster(const Frame& frame, const Batch& batch, uint32_t lane, uint32_t selected,
                        const Sample& sample, Worker& worker) {
    const Kernels& k = *frame.kernels;
    Rays& ray = worker.rays; // of which only this much is read
    for (uint32_t i = 0; i < 3; ++i) {
        ray.centre[i] = batch.position[i][lane];
        ray.direction[i] = sample.direction[i];
    }
    ray.radius = 0;
    const uint32_t met =
        k.select_along(ray, frame.cluster_bounds, worker.selected.data(), 0, selected, worker.along.data());
    for (uint32_t i = 0; i < met; ++i) {
        const uint32_t c = worker.along[i];
        const ClusterView& view = frame.views[c];
        const float* points =
            frame.points.data() + 4 * size_t(frame.meshes[frame.cluster_mesh[c]].first_point);
        for (uint64_t left = k.triangles_along(ray, view); left; left &= left - 1) {
            const uint32_t t = static_cast<uint32_t>(__builtin_ctzll(left));
            if (hides(batch, lane, view, points, t, sample)) return c;
        }
    }
    return no_cluster;
}

} // namespace

void cover_last_samples(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers,
                        const Batch& batch, uint32_t selected, Worker& worker) {
    const MaskLayout& layout = frame.tables->layout;
    const size_t bytes = mask_bytes(layout);
    uint32_t bits[most_last_samples(fine_layout)];
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (!(batch.valid >> lane & 1)) continue;
        uint8_t* const mask = worker.masks.data() + lane * bytes;
        const uint32_t count = find_last_samples(layout, mask, bits);
        for (uint32_t i = 0; i < count; ++i) {
            const Sample sample = sample_of(layout, batch, lane, bits[i]);
            const bool below = is_below_fan(frame, slice, receivers[lane], batch, lane, sample);
            const uint32_t c =
                below ? no_cluster : hiding_cluster(frame, batch, lane, selected, sample, worker);
            // One that is truly open tells that the receiver is not enclosed, and the others are not asked:
            // each costs a ray, and where leaves or hair leave a few open that adds up.
            if (!below && c == no_cluster) break;
            if (frame.record) std::memcpy(worker.masks_before.data() + lane * bytes, mask, bytes);
            mask[bits[i] / 8] = uint8_t(mask[bits[i] / 8] | 1u << bits[i] % 8);
            if (frame.record && !below) record_visible(frame, slice, receivers, c, 1u << lane, worker);
        }
    }
}

} // namespace nusselt
