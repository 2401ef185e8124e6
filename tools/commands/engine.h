// The library as the commands use it: one scene, all of its meshes one shadow group.
#pragma once

#include "bench/scenes/scene.h"
#include "tools/commands/reflection.h"
#include "tools/commands/streams.h"

#include <nusselt/nusselt.h>

#include <cstdint>
#include <optional>
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

struct Image;

// Of which vertices the back gets results too: none, those that the scene says are seen from both sides, all.
enum class TwoSided { off, model, all };
TwoSided parse_two_sided(const std::string& name); // throws Failure (usage) with what there is

// Whether any vertex has a back in that sense.
bool has_backs(const scenes::Scene& scene, TwoSided which);

// What lies behind the vertices, as Engine::frame gives it of their fronts. Zeros where there is no back.
struct BackArrays {
    std::vector<float> transfer;
    std::vector<uint32_t> masks;
    std::vector<StreamArray> streams; // described by the caller
};

class Engine {
public:
    // Adds every mesh in its rest pose. `subject` is the file or scene for messages.
    Engine(const scenes::Scene& scene, const EngineOptions& options, std::string subject);
    ~Engine();
    Engine(const Engine&) = delete;
    Engine& operator=(const Engine&) = delete;

    // Transfer vectors of all meshes in order, 25 floats a vertex; masks and further streams too where asked
    // for.
    FrameStats frame(const scenes::Pose& pose, Quality quality, std::vector<float>& transfer,
                     std::vector<uint32_t>* masks = nullptr, std::vector<StreamArray>* streams = nullptr);

    // The frames that follow leave transfer vectors out and make the streams alone.
    void make_streams_alone(bool alone) { streams_alone_ = alone; }

    // The frames that follow fill these too, masks where they do. They stay with the caller.
    // `whole`: of each mesh that has any, those of all vertices.
    void see_backs(TwoSided which, BackArrays* backs, bool whole = false);

    // Materials, viewer and light of the frames that follow, for streams that depend on them. `palette` is of
    // the engine's scene and stays with the caller.
    void look(const Palette& palette, const glm::vec3& eye, const std::vector<float>& light);

    // Light alone: surfaces are white and Lambert.
    void light(const std::vector<float>& light) { light_ = light; }

    // Occlusion of the frames that follow fades with distance.
    void fade(const Falloff& falloff) { falloff_ = falloff; }
    // The frames that follow keep what did not move since the one before (FrameDesc::history).
    void keep_still();
    // The frames that follow round coordinates about one point (FrameDesc::origin), that of the first: one
    // that moves with the model would have all move, and a history keep nothing.
    void hold_origin() { holds_origin_ = true; }
    void make_watertight() { watertight_ = true; } // FrameDesc::watertight, in the frames to come

    // Which object each mesh belongs to, in the frames that follow (FrameMesh::object).
    void group(const std::vector<uint32_t>& objects);

    // The frames that follow, at that quality, are recorded into a new visible set of so many segments.
    void record_visible(Quality quality, uint32_t segments);
    // The set as a file holds it.
    std::string visible_set() const;
    // The frames that follow look at what the file's set holds (`name` for messages), or at all again.
    void use_visible(const std::string& bytes, const std::string& name);
    void use_visible(bool wanted) { visible_role_ = wanted ? VisibleRole::used : VisibleRole::none; }
    VisibleSetInfo visible_info() const;
    // Of each vertex of all meshes, the part of the clusters that the set has it look at, in the segment
    // chosen.
    std::vector<float> visible_parts() const;
    // The segment that frames are recorded into, or look at.
    void choose_segment(uint32_t segment) { visible_segment_ = segment; }

    // The environment of the frames that follow, for direct light at that quality.
    void surround(const Image& environment, Quality quality);

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
    std::vector<uint8_t> receives_; // of each mesh; what hides nothing is frame_'s
    HistoryId history_;
    bool holds_origin_ = false;
    std::optional<glm::vec3> origin_; // once there was a frame that holds it
    std::vector<Output> outputs_;     // of each mesh in turn, the front's and then the back's
    std::vector<std::vector<uint32_t>> two_sided_, turned_; // bits of each mesh's vertices: known, asked for
    BackArrays* backs_ = nullptr;
    std::vector<Gloss> gloss_; // of each mesh, or none
    std::vector<float> light_;
    Environment* environment_ = nullptr;
    Falloff falloff_;
    bool watertight_ = false, streams_alone_ = false;
    enum class VisibleRole { none, recorded, used };
    VisibleSet* visible_ = nullptr;
    VisibleRole visible_role_ = VisibleRole::none;
    uint32_t visible_segment_ = 0;
};

// Of a clip of that duration, cut into equal segments.
uint32_t segment_at(double time, double duration, uint32_t segments);

// `environment` in SH: 25 terms of 3 channels. Pixels that are not finite or negative count as black, and are
// told on stderr once.
std::vector<float> project_environment(const Image& environment, const std::string& name);

} // namespace nusselt::tools
