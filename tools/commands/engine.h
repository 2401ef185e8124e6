// The library as the commands use it: one scene, all of its meshes one shadow group.
#pragma once

#include "bench/scenes/scene.h"

#include <nusselt/nusselt.h>

#include <cstdint>
#include <string>
#include <vector>

namespace nusselt::tools {

struct EngineOptions {
    uint32_t threads = 0; // 1: serial; 0: as many as the machine has
    Isa isa = Isa::best;
    Allocator allocator{}; // default: the C++ heap
};

// Throw Failure (usage) with the list of what there is.
Quality parse_quality(const std::string& name);
Isa parse_isa(const std::string& name);
// The same for the environment variable NUSSELT_ISA, which the library reads when no instruction set is asked
// for.
void check_isa_variable();

class Engine {
public:
    // Adds every mesh in its rest pose. `subject` is the file or scene for messages.
    Engine(const scenes::Scene& scene, const EngineOptions& options, std::string subject);
    ~Engine();
    Engine(const Engine&) = delete;
    Engine& operator=(const Engine&) = delete;

    // Transfer vectors of all meshes in order, 25 floats a vertex; masks too where asked for.
    FrameStats frame(const scenes::Pose& pose, Quality quality, std::vector<float>& transfer,
                     std::vector<uint32_t>* masks = nullptr);

    // Radiance leaving each vertex, 3 floats, of transfer vectors from wherever.
    std::vector<float> shade(const float light[75], std::vector<float>& transfer,
                             const std::vector<glm::vec3>& albedo) const;

    Isa isa() const { return context_isa(context_); }
    uint32_t threads() const { return threads_; }
    MeshInfo mesh(size_t number) const;

private:
    void check(const Status& status) const;

    std::string subject_;
    Executor executor_;
    uint32_t threads_ = 1;
    Context* context_ = nullptr;
    std::vector<MeshId> meshes_;
    std::vector<FrameMesh> frame_;
};

// `environment` in SH: 25 terms of 3 channels. Pixels that aren't finite or negative count as black, and are
// told on stderr once.
struct Image;
std::vector<float> project_environment(const Image& environment, const std::string& name);

} // namespace nusselt::tools
