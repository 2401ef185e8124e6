#include "bench/recording.h"

#include "bench/scenes/scene.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>

namespace nusselt::bench {

using namespace kernels;

namespace {

void check(const Status& status) {
    if (status.ok()) return;
    std::fprintf(stderr, "bench: %s\n", status.text);
    std::exit(1);
}

Vec3View view(const std::vector<glm::vec3>& vectors) {
    return {&vectors[0].x, vectors.size(), sizeof(glm::vec3)};
}

} // namespace

void Jobs::reserve(size_t capacity) {
    for (Aligned<uint32_t>& array : plane)
        array.resize(capacity + 16);
    destination.resize(capacity + 16);
}

Recording::Recording(Quality quality, uint32_t batch_count) {
    const scenes::Scene scene = scenes::builtin("hand");
    const scenes::Mesh& source = scene.meshes[0];
    scenes::Pose pose;
    scene.pose(0.4 * scene.duration, pose);
    check(create_context({}, &context));
    MeshDesc mesh_desc;
    mesh_desc.rest_positions = view(source.rest_positions);
    mesh_desc.rest_normals = view(source.rest_normals);
    mesh_desc.indices = source.indices.data();
    mesh_desc.index_count = source.indices.size();
    MeshId id;
    check(add_mesh(context, mesh_desc, &id));
    transfer.resize(source.rest_positions.size() * 25);
    FrameMesh mesh{id,
                   view(pose.positions[0]),
                   view(pose.normals[0]),
                   {transfer.data(), source.rest_positions.size(), 100},
                   {}};
    FrameId frame_id;
    check(submit(context, {&mesh, 1, quality}, &frame_id));
    check(wait(context, frame_id, nullptr));

    // A frame's arrays stay when it is done.
    frame = context->frames[0];
    tables = frame->tables;
    const MeshSlice& slice = frame->meshes[0];
    const MeshData& data = *slice.mesh;
    const Kernels& scalar = *kernels_for(Set::scalar);
    const auto all = static_cast<uint32_t>(data.receivers.size() / lanes);
    batch_count = std::min(batch_count, all);
    const float* points = frame->points.data() + 4 * size_t(slice.first_point);
    std::vector<uint32_t> selected(frame->cluster_count + 16);
    const auto scratch = std::make_unique<ClusterScratch>();
    Counters counters{};
    masks.resize(size_t{batch_count} * lanes * mask_bytes(tables->layout));
    locals.resize(batch_count);
    jobs.resize(batch_count);
    for (uint32_t b = 0; b < batch_count; ++b) {
        const uint32_t* receivers = data.receivers.data() + size_t{b} * all / batch_count * lanes;
        Batch batch{};
        Normals normal;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            for (uint32_t k = 0; k < 3; ++k) {
                batch.position[k][lane] = points[4 * size_t(data.weld[receivers[lane]]) + k];
                normal.values[k][lane] = pose.normals[0][receivers[lane]][static_cast<int>(k)];
            }
        }
        batch.valid = 0xFFFF;
        unprepared.push_back(batch);
        normals.push_back(normal);
        scalar.prepare_batch(batch, normal.values);
        batches.push_back(batch);

        uint32_t fan_count[lanes], ring_count[lanes], longest_fan = 0, longest_ring = 0;
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            const uint32_t w = data.weld[receivers[lane]];
            fan_count[lane] = data.fan_begin[w + 1] - data.fan_begin[w];
            ring_count[lane] = data.ring_begin[w + 1] - data.ring_begin[w];
            longest_fan = std::max(longest_fan, fan_count[lane]);
            longest_ring = std::max(longest_ring, ring_count[lane]);
        }
        for (uint32_t i = 0; i < longest_fan; ++i) {
            FanCorners fan{};
            fan.batch = b;
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                if (i >= fan_count[lane]) continue;
                fan.active |= 1u << lane;
                const uint32_t begin = data.fan_begin[data.weld[receivers[lane]]];
                for (uint32_t side = 0; side < 2; ++side)
                    for (uint32_t k = 0; k < 3; ++k)
                        fan.values[side][k][lane] =
                            points[4 * size_t(data.fan[2 * size_t(begin + i) + side]) + k];
            }
            fans.push_back(fan);
        }
        for (uint32_t i = 0; i < longest_ring; ++i) {
            TriangleCorners triangle{};
            triangle.batch = b;
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                if (i >= ring_count[lane]) continue;
                const uint32_t t = data.ring[data.ring_begin[data.weld[receivers[lane]]] + i];
                triangle.active |= 1u << lane;
                triangle.two_sided |= uint32_t(data.full_two_sided[t]) << lane;
                for (uint32_t corner = 0; corner < 3; ++corner)
                    for (uint32_t k = 0; k < 3; ++k)
                        triangle.values[corner][k][lane] =
                            points[4 * size_t(data.full_triangles[3 * size_t(t) + corner]) + k];
            }
            triangles.push_back(triangle);
        }

        uint64_t tested = 0;
        const uint32_t count =
            scalar.select_clusters(batch.bounds, frame->cluster_bounds, nullptr, frame->cluster_count,
                                   tables->horizon, selected.data(), &tested);
        Jobs& made = jobs[b];
        made.reserve(size_t{count + 1} * jobs_per_cluster(tables->layout));
        JobList list = made.list();
        for (uint32_t i = 0; i < count; ++i) {
            pairs.push_back({b, selected[i]});
            scalar.cluster_jobs(batch, frame->views[selected[i]], points, tables->layout, tables->horizon,
                                *scratch, list, counters);
        }
        made.count = list.count;
        uint8_t* mask = masks.data() + size_t{b} * lanes * mask_bytes(tables->layout);
        JobList replay = made.list();
        scalar.run_jobs(*tables, replay, mask);
        scalar.integrate(*tables, mask, batch.valid, false, 5, locals[b].values, counters);
    }
}

Recording::~Recording() {
    (void)destroy_context(context);
}

Recording& recording(Quality quality) {
    static std::map<Quality, std::unique_ptr<Recording>> recordings;
    std::unique_ptr<Recording>& made = recordings[quality];
    if (!made) made = std::make_unique<Recording>(quality, 96);
    return *made;
}

} // namespace nusselt::bench
