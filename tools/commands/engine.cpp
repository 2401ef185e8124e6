#include "tools/commands/engine.h"

#include "tools/image/image.h"
#include "tools/report/failure.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <thread>

namespace nusselt::tools {

namespace {

std::string available_isas() {
    std::string list;
    for (const Isa isa : {Isa::scalar, Isa::sse4, Isa::avx2, Isa::avx512})
        if (isa_available(isa)) list += std::string(list.empty() ? "" : ", ") + isa_name(isa);
    return list;
}

Vec3View view(const std::vector<glm::vec3>& vectors) {
    return {vectors.empty() ? nullptr : &vectors[0].x, vectors.size(), sizeof(glm::vec3)};
}

// One side of a mesh: its part of arrays over all vertices, which begin at `first`. `outputs` has room.
BackSide part_of(size_t first, size_t count, size_t words, std::vector<float>& transfer,
                 std::vector<uint32_t>* masks, std::vector<StreamArray>& streams, Output* outputs) {
    BackSide side;
    if (!transfer.empty()) side.transfer = {transfer.data() + first * 25, count, 100};
    if (masks) side.masks = {masks->data() + first * words, count, words * 4};
    side.outputs = outputs;
    side.output_count = static_cast<uint32_t>(streams.size());
    for (StreamArray& stream : streams) {
        Output& output = *outputs++;
        output = {};
        output.kind = stream.kind;
        output.format = stream.format;
        output.bands = stream.bands;
        std::copy(std::begin(stream.window), std::end(stream.window), output.window);
        output.data = stream.bytes.data() + first * stream.element();
        output.count = count;
    }
    return side;
}

// The first mesh with the same topology and rest pose as the scene's m-th: nodes that draw one mesh share its
// levels of detail.
size_t first_like(const scenes::Scene& scene, size_t m) {
    const scenes::Mesh& mesh = scene.meshes[m];
    for (size_t k = 0; k < m; ++k) {
        const scenes::Mesh& other = scene.meshes[k];
        if (other.indices == mesh.indices && other.rest_positions == mesh.rest_positions &&
            other.rest_normals == mesh.rest_normals)
            return k;
    }
    return m;
}

bool has_bits(const std::vector<uint32_t>& bits) {
    return std::any_of(bits.begin(), bits.end(), [](uint32_t word) { return word != 0; });
}

} // namespace

Quality parse_quality(const std::string& name) {
    Quality quality = Quality::standard;
    if (quality_from_name(name.c_str(), &quality)) return quality;
    std::string list;
    for (const Quality each : {Quality::paper, Quality::draft, Quality::standard, Quality::fine})
        list += std::string(list.empty() ? "" : ", ") + quality_name(each);
    throw Failure("--quality", "there is no quality '" + name + "'; choose one of " + list, exit_usage);
}

Isa parse_isa(const std::string& name) {
    Isa isa = Isa::best;
    if (!isa_from_name(name.c_str(), &isa)) {
        throw Failure("--isa",
                      "there is no instruction set '" + name + "'; this machine has " + available_isas(),
                      exit_usage);
    }
    if (isa != Isa::best && !isa_available(isa)) {
        throw Failure("--isa", "'" + name + "' is not available here; this machine has " + available_isas(),
                      exit_usage);
    }
    return isa;
}

void check_isa_variable() {
    const char* name = std::getenv("NUSSELT_ISA");
    Isa isa = Isa::best;
    if (!name || !*name) return;
    if (!isa_from_name(name, &isa) || (isa != Isa::best && !isa_available(isa))) {
        throw Failure("NUSSELT_ISA",
                      std::string("the environment asks for '") + name +
                          "', which is not available; this machine has " + available_isas(),
                      exit_usage);
    }
}

TwoSided parse_two_sided(const std::string& name) {
    constexpr const char* names[] = {"off", "model", "all"};
    const auto* const it = std::find(std::begin(names), std::end(names), name);
    if (it == std::end(names))
        throw Failure("--two-sided", "there is no '" + name + "'; choose off, model or all", exit_usage);
    return static_cast<TwoSided>(it - std::begin(names));
}

bool has_backs(const scenes::Scene& scene, TwoSided which) {
    const auto is_sheet = [](const scenes::Mesh& mesh) {
        return std::any_of(mesh.two_sided.begin(), mesh.two_sided.end(),
                           [](uint8_t two) { return two != 0; });
    };
    return which == TwoSided::all ||
           (which == TwoSided::model && std::any_of(scene.meshes.begin(), scene.meshes.end(), is_sheet));
}

Engine::Engine(const scenes::Scene& scene, const EngineOptions& options, std::string subject)
    : subject_(std::move(subject)), executor_(serial_executor()) {
    try {
        threads_ = options.threads ? options.threads : std::max(1u, std::thread::hardware_concurrency());
        if (threads_ > 1) {
            const Status status = create_tbb_executor(threads_, &executor_);
            // A build without TBB still works, on one thread, unless more were asked for.
            if (status.code == StatusCode::unsupported && options.threads == 0) {
                executor_ = serial_executor();
                threads_ = 1;
            } else {
                check(status);
            }
        }
        ContextDesc desc;
        desc.allocator = options.allocator;
        desc.executor = executor_;
        desc.isa = options.isa;
        check(create_context(desc, &context_));
        for (const scenes::Mesh& mesh : scene.meshes) {
            MeshDesc mesh_desc;
            mesh_desc.rest_positions = view(mesh.rest_positions);
            mesh_desc.rest_normals = view(mesh.rest_normals);
            mesh_desc.indices = mesh.indices.data();
            mesh_desc.index_count = mesh.indices.size();
            MeshId id;
            const size_t same = first_like(scene, meshes_.size());
            check(same < meshes_.size() ? share_mesh(context_, meshes_[same], &id)
                                        : add_mesh(context_, mesh_desc, &id));
            meshes_.push_back(id);
            receives_.push_back(mesh.receives);
            frame_.emplace_back().receive_only = !mesh.hides;
            std::vector<uint32_t>& bits = two_sided_.emplace_back((mesh.rest_positions.size() + 31) / 32);
            for (size_t v = 0; v < mesh.two_sided.size(); ++v)
                bits[v / 32] |= uint32_t{mesh.two_sided[v] != 0} << v % 32;
        }
    } catch (...) {
        (void)destroy_context(context_);
        destroy_executor(&executor_);
        throw;
    }
}

Engine::~Engine() {
    destroy_environment(context_, environment_);
    destroy_visible_set(context_, visible_);
    // No frame outlives the call that submitted it, so the context is never busy.
    (void)destroy_context(context_);
    destroy_executor(&executor_);
}

void Engine::check(const Status& status) const {
    if (!status.ok()) throw Failure(subject_, status.text);
}

MeshInfo Engine::mesh(size_t number) const {
    MeshInfo info;
    check(mesh_info(context_, meshes_[number], &info));
    return info;
}

void Engine::look(const Palette& palette, const glm::vec3& eye, const std::vector<float>& light) {
    gloss_.assign(meshes_.size(), {});
    for (size_t m = 0; m < meshes_.size(); ++m) {
        Gloss& gloss = gloss_[m];
        gloss.eye[0] = eye.x;
        gloss.eye[1] = eye.y;
        gloss.eye[2] = eye.z;
        gloss.materials = palette.materials.data();
        gloss.material_count = static_cast<uint32_t>(palette.materials.size());
        gloss.material_of = palette.material_of[m].data();
    }
    light_ = light;
}

void Engine::keep_still() {
    if (history_.generation == 0) check(create_history(context_, &history_));
}

void Engine::group(const std::vector<uint32_t>& objects) {
    for (size_t m = 0; m < frame_.size(); ++m)
        frame_[m].object = objects[m];
}

void Engine::record_visible(Quality quality, uint32_t segments) {
    destroy_visible_set(context_, visible_);
    visible_ = nullptr;
    check(create_visible_set(context_, meshes_.data(), static_cast<uint32_t>(meshes_.size()), quality,
                             segments, &visible_));
    visible_role_ = VisibleRole::recorded;
}

std::string Engine::visible_set() const {
    std::string bytes(visible_set_bytes(visible_), '\0');
    check(write_visible_set(visible_, bytes.data(), bytes.size()));
    return bytes;
}

void Engine::use_visible(const std::string& bytes, const std::string& name) {
    VisibleSet* read = nullptr;
    const Status status = read_visible_set(context_, meshes_.data(), static_cast<uint32_t>(meshes_.size()),
                                           bytes.data(), bytes.size(), &read);
    if (!status.ok()) throw Failure(name, status.text);
    destroy_visible_set(context_, visible_);
    visible_ = read;
    visible_role_ = VisibleRole::used;
}

VisibleSetInfo Engine::visible_info() const {
    VisibleSetInfo info;
    check(visible_set_info(visible_, &info));
    return info;
}

std::vector<float> Engine::visible_parts() const {
    std::vector<float> parts;
    for (uint32_t m = 0; m < meshes_.size(); ++m) {
        const size_t first = parts.size(), count = mesh(m).vertices;
        parts.resize(first + count);
        check(visible_set_parts(context_, visible_, visible_segment_, m, meshes_[m], parts.data() + first,
                                count));
    }
    return parts;
}

void Engine::surround(const Image& environment, Quality quality) {
    destroy_environment(context_, environment_);
    environment_ = nullptr;
    EnvironmentDesc desc;
    desc.rgb = environment.rgb.data();
    desc.width = environment.width;
    desc.height = environment.height;
    desc.mask_bits = quality_mask_bits(quality);
    check(create_environment(context_, desc, &environment_));
}

void Engine::see_backs(TwoSided which, BackArrays* backs, bool whole) {
    backs_ = which == TwoSided::off ? nullptr : backs;
    turned_ = two_sided_;
    for (std::vector<uint32_t>& bits : turned_) {
        if (which == TwoSided::all || (whole && has_bits(bits))) bits.assign(bits.size(), ~uint32_t{0});
    }
}

FrameStats Engine::frame(const scenes::Pose& pose, Quality quality, std::vector<float>& transfer,
                         std::vector<uint32_t>* masks, std::vector<StreamArray>* streams) {
    size_t vertices = 0;
    for (const std::vector<glm::vec3>& positions : pose.positions)
        vertices += positions.size();
    const size_t words = quality_mask_bits(quality) / 32;
    const auto grow = [&](std::vector<float>& t, std::vector<uint32_t>* m, std::vector<StreamArray>& s) {
        t.resize(streams_alone_ ? 0 : vertices * 25);
        if (m) m->resize(vertices * words);
        for (StreamArray& stream : s)
            stream.bytes.resize(vertices * stream.element());
    };
    std::vector<StreamArray> none;
    std::vector<StreamArray>& front_streams = streams ? *streams : none;
    grow(transfer, masks, front_streams);
    BackArrays no_backs;
    BackArrays& backs = backs_ ? *backs_ : no_backs;
    std::vector<uint32_t>* const back_masks = masks ? &backs.masks : nullptr;
    if (backs_) grow(backs.transfer, back_masks, backs.streams);
    outputs_.resize(meshes_.size() * (front_streams.size() + backs.streams.size()));
    Output* outputs = outputs_.data();
    size_t first = 0;
    for (size_t m = 0; m < meshes_.size(); ++m) {
        const size_t count = pose.positions[m].size();
        frame_[m].mesh = meshes_[m];
        frame_[m].positions = view(pose.positions[m]);
        frame_[m].normals = view(pose.normals[m]);
        const BackSide front =
            receives_[m] ? part_of(first, count, words, transfer, masks, front_streams, outputs) : BackSide{};
        outputs += front.output_count;
        frame_[m].transfer = front.transfer;
        frame_[m].masks = front.masks;
        frame_[m].outputs = front.outputs;
        frame_[m].output_count = front.output_count;
        frame_[m].back = {};
        if (backs_ && receives_[m] && has_bits(turned_[m])) {
            frame_[m].back = part_of(first, count, words, backs.transfer, back_masks, backs.streams, outputs);
            frame_[m].back.needed = turned_[m].data();
            outputs += backs.streams.size();
        }
        frame_[m].gloss = gloss_.empty() ? nullptr : &gloss_[m];
        first += count;
    }
    FrameDesc desc;
    desc.environment = environment_;
    desc.falloff = falloff_;
    desc.watertight = watertight_;
    desc.history = history_;
    for (size_t m = 0; holds_origin_ && !origin_ && m < pose.positions.size(); ++m) {
        if (!pose.positions[m].empty()) origin_ = pose.positions[m][0];
    }
    if (origin_) desc.origin = &origin_->x;
    if (visible_role_ == VisibleRole::recorded) desc.record = visible_;
    if (visible_role_ == VisibleRole::used) desc.visible = visible_;
    desc.visible_segment = visible_segment_;
    desc.light = light_.empty() ? nullptr : light_.data();
    desc.meshes = frame_.data();
    desc.mesh_count = static_cast<uint32_t>(frame_.size());
    desc.quality = quality;
    FrameId id;
    FrameStats stats;
    check(submit(context_, desc, &id));
    check(wait(context_, id, &stats));
    return stats;
}

std::vector<float> Engine::shade(const float light[75], std::vector<float>& transfer,
                                 const std::vector<glm::vec3>& albedo) const {
    std::vector<float> radiance(albedo.size() * 3);
    check(nusselt::shade(context_, light, {transfer.data(), albedo.size(), 100}, view(albedo),
                         radiance.data()));
    return radiance;
}

uint32_t segment_at(double time, double duration, uint32_t segments) {
    const double part = duration > 0 ? time / duration : 0;
    return std::min(static_cast<uint32_t>(std::max(part, 0.0) * segments), segments - 1);
}

std::vector<float> project_environment(const Image& environment, const std::string& name) {
    std::vector<float> light(75);
    uint64_t bad = 0;
    const Status status =
        sh_project_latlong(environment.rgb.data(), environment.width, environment.height, light.data(), &bad);
    if (!status.ok()) throw Failure(name, status.text);
    if (bad > 0) {
        const std::string text =
            std::to_string(bad) +
            " pixels are negative or not finite and count as black, or above 1e35 and count as that; "
            "repair the image";
        std::fprintf(stderr, "%s\n", failure_line(name, text).c_str());
    }
    return light;
}

} // namespace nusselt::tools
