// One scene in one context, ready to be submitted.
#pragma once

#include "bench/scenes/scene.h"
#include "nusselt/nusselt.h"

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <thread>
#include <vector>

namespace nusselt::test {

// Threads of their own, one a task.
struct ThreadExecutor {
    static Executor hook(uint32_t concurrency) {
        return {
            nullptr,
            [](void*, void (*run)(void*), void* argument) -> void* { return new std::thread(run, argument); },
            [](void*, void* ticket) {
                std::thread* thread = static_cast<std::thread*>(ticket);
                thread->join();
                delete thread;
            },
            concurrency};
    }
};

// Made once: the cloth is a simulation.
inline const scenes::Scene& scene_of(const std::string& name) {
    static std::map<std::string, scenes::Scene> made;
    const auto [entry, is_new] = made.try_emplace(name);
    if (is_new) entry->second = scenes::builtin(name);
    return entry->second;
}

struct Host {
    explicit Host(const std::string& name, const ContextDesc& desc = {}) : scene(scene_of(name)) {
        EXPECT_TRUE(create_context(desc, &context).ok());
        scene.pose(0.3, pose);
        for (size_t m = 0; m < scene.meshes.size(); ++m) {
            const scenes::Mesh& mesh = scene.meshes[m];
            const size_t count = mesh.rest_positions.size();
            MeshId id;
            EXPECT_TRUE(add_mesh(context,
                                 {{&mesh.rest_positions[0].x, count, 12},
                                  {&mesh.rest_normals[0].x, count, 12},
                                  mesh.indices.data(),
                                  mesh.indices.size()},
                                 &id)
                            .ok());
            transfer.emplace_back(25 * count, unset);
            meshes.push_back({id,
                              {&pose.positions[m][0].x, count, 12},
                              {&pose.normals[m][0].x, count, 12},
                              {transfer[m].data(), count, 100},
                              {}});
        }
    }
    ~Host() { EXPECT_TRUE(destroy_context(context).ok()); }
    Host(const Host&) = delete;
    Host& operator=(const Host&) = delete;

    FrameDesc frame() const { return {meshes.data(), static_cast<uint32_t>(meshes.size())}; }

    // Vertices whose transfer vector was written whole; fails where one was written in part.
    uint32_t written() const {
        uint32_t count = 0;
        for (const std::vector<float>& mesh : transfer) {
            for (size_t v = 0; v < mesh.size(); v += 25) {
                uint32_t terms = 0;
                for (size_t i = 0; i < 25; ++i)
                    terms += mesh[v + i] != unset;
                EXPECT_TRUE(terms == 0 || terms == 25) << terms;
                count += terms == 25;
            }
        }
        return count;
    }

    static constexpr float unset = -12345;
    const scenes::Scene& scene;
    scenes::Pose pose;
    Context* context = nullptr;
    std::vector<std::vector<float>> transfer;
    std::vector<FrameMesh> meshes;
};

} // namespace nusselt::test
