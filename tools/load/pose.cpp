// Evaluates a rig at a time: keys, node hierarchy, morph targets, skins, normals (glTF 2.0, section 3.7 and
// appendix C).
#include "tools/load/error.h"
#include "tools/load/rig.h"

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nusselt::load {
namespace {

struct Scratch {
    std::vector<RigNode> nodes;
    std::vector<glm::dmat4> worlds;
    std::vector<std::vector<float>> weights;
    std::vector<glm::mat4> palette;
    std::vector<glm::vec3> positions, normals;
    std::vector<glm::dvec3> sums;
};

glm::dquat slerp(glm::dquat a, glm::dquat b, double u) {
    double cosine = glm::dot(a, b);
    if (cosine < 0) { // the shorter way round
        b = -b;
        cosine = -cosine;
    }
    if (cosine > 0.9999) return glm::normalize(a * (1.0 - u) + b * u); // sin below would lose its digits
    const double angle = std::acos(cosine);
    return glm::normalize((a * std::sin((1.0 - u) * angle) + b * std::sin(u * angle)) / std::sin(angle));
}

glm::dquat to_quaternion(const double* v) {
    const glm::dquat q(v[3], v[0], v[1], v[2]); // glTF stores x, y, z, w
    const double length = glm::length(q);
    return length > 0 ? q / length : glm::dquat(1.0, 0.0, 0.0, 0.0);
}

// The track's value at `time`, `width` numbers.
void sample(const Track& track, double time, std::vector<double>& out) {
    const size_t width = track.width;
    const bool cubic = track.interpolation == Interpolation::cubic;
    const size_t stride = cubic ? 3 * width : width;
    const size_t middle = cubic ? width : 0; // where a key's value begins
    out.resize(width);
    const auto key = [&](size_t k) { return track.values.data() + k * stride; };
    const auto take = [&](size_t k) { std::copy_n(key(k) + middle, width, out.begin()); };

    const auto after = std::upper_bound(track.times.begin(), track.times.end(), time,
                                        [](double t, float k) { return t < static_cast<double>(k); });
    if (after == track.times.begin()) return take(0);
    const auto next = static_cast<size_t>(after - track.times.begin());
    const size_t previous = next - 1;
    if (next == track.times.size() || track.interpolation == Interpolation::step) return take(previous);

    const double begin = track.times[previous];
    const double interval = static_cast<double>(track.times[next]) - begin; // > 0: upper_bound
    const double u = (time - begin) / interval;
    const float* a = key(previous) + middle;
    const float* b = key(next) + middle;
    if (cubic) {
        const double u2 = u * u, u3 = u2 * u;
        const float* leave = key(previous) + 2 * width;
        const float* arrive = key(next);
        for (size_t i = 0; i < width; ++i) {
            out[i] = (2 * u3 - 3 * u2 + 1) * static_cast<double>(a[i]) +
                     (u3 - 2 * u2 + u) * interval * static_cast<double>(leave[i]) +
                     (3 * u2 - 2 * u3) * static_cast<double>(b[i]) +
                     (u3 - u2) * interval * static_cast<double>(arrive[i]);
        }
    } else if (track.path == Path::rotation) {
        const double from[4] = {a[0], a[1], a[2], a[3]};
        const double to[4] = {b[0], b[1], b[2], b[3]};
        const glm::dquat q = slerp(to_quaternion(from), to_quaternion(to), u);
        out = {q.x, q.y, q.z, q.w};
    } else {
        for (size_t i = 0; i < width; ++i) {
            out[i] = static_cast<double>(a[i]) + u * (static_cast<double>(b[i]) - static_cast<double>(a[i]));
        }
    }
}

// Node transforms and morph weights at a time of the clip, or as the nodes stand (clip null).
void pose_nodes(const Rig& rig, const RigClip* clip, double time, Scratch& scratch) {
    scratch.nodes = rig.nodes;
    scratch.weights = rig.node_weights;
    if (clip) {
        std::vector<double> value;
        for (const Track& track : clip->tracks) {
            sample(track, time, value);
            RigNode& node = scratch.nodes[static_cast<size_t>(track.node)];
            switch (track.path) {
            case Path::translation:
                node.translation = {value[0], value[1], value[2]};
                break;
            case Path::rotation:
                node.rotation = to_quaternion(value.data());
                break;
            case Path::scale:
                node.scale = {value[0], value[1], value[2]};
                break;
            case Path::weights: {
                std::vector<float>& weights = scratch.weights[static_cast<size_t>(track.node)];
                const size_t count = std::min(weights.size(), value.size());
                for (size_t i = 0; i < count; ++i) {
                    weights[i] = static_cast<float>(value[i]);
                }
                break;
            }
            }
            if (track.path != Path::weights) node.has_matrix = false;
        }
    }
    scratch.worlds.resize(rig.nodes.size());
    for (const int index : rig.order) {
        const RigNode& node = scratch.nodes[static_cast<size_t>(index)];
        glm::dmat4 local = node.matrix;
        if (!node.has_matrix) {
            const glm::dmat3 turn = glm::mat3_cast(node.rotation);
            local =
                glm::dmat4(glm::dvec4(turn[0] * node.scale.x, 0.0), glm::dvec4(turn[1] * node.scale.y, 0.0),
                           glm::dvec4(turn[2] * node.scale.z, 0.0), glm::dvec4(node.translation, 1.0));
        }
        scratch.worlds[static_cast<size_t>(index)] =
            node.parent < 0 ? local : scratch.worlds[static_cast<size_t>(node.parent)] * local;
    }
}

// Skin matrices of a draw; the last one is the node's own.
void pose_palette(const Rig& rig, const Draw& draw, Scratch& scratch) {
    const RigSkin& skin = rig.skins[static_cast<size_t>(draw.skin)];
    scratch.palette.resize(skin.joints.size() + 1);
    for (size_t j = 0; j < skin.joints.size(); ++j) {
        scratch.palette[j] =
            glm::mat4(scratch.worlds[static_cast<size_t>(skin.joints[j])] * skin.inverse_bind[j]);
    }
    scratch.palette.back() = glm::mat4(scratch.worlds[static_cast<size_t>(draw.node)]);
}

glm::mat4 blend(const Source& source, const std::vector<glm::mat4>& palette, size_t vertex) {
    glm::mat4 matrix(0.0f);
    for (uint32_t i = 0; i < source.influences; ++i) {
        const float weight = source.weights[vertex * source.influences + i];
        if (weight == 0.0f) continue;
        const uint16_t joint = source.joints[vertex * source.influences + i];
        matrix += (joint == rigid_joint ? palette.back() : palette[joint]) * weight;
    }
    return matrix;
}

// det(M) times the inverse transpose: carries normals, and exists where the inverse doesn't.
template<class Matrix3>
Matrix3 cofactors(const Matrix3& m) {
    return Matrix3(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1]));
}

// Scaled first: squares of a tiny or huge vector would leave the range of float.
glm::vec3 unit(const glm::dvec3& v) {
    const double largest = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    if (!(largest > 0) || !std::isfinite(largest)) return {0.0f, 1.0f, 0.0f};
    return glm::vec3(glm::normalize(v / largest));
}

// Area-weighted normals over welded vertices, written where a normal is missing.
void area_normals(const Source& source, const std::vector<glm::vec3>& positions, bool mirrored,
                  std::vector<glm::dvec3>& sums, std::vector<glm::vec3>& normals) {
    sums.assign(positions.size(), glm::dvec3(0.0));
    for (size_t i = 0; i + 2 < source.indices.size(); i += 3) {
        const uint32_t corner[3] = {source.indices[i], source.indices[i + 1], source.indices[i + 2]};
        const glm::dvec3 origin(positions[corner[0]]);
        const glm::dvec3 area =
            glm::cross(glm::dvec3(positions[corner[1]]) - origin, glm::dvec3(positions[corner[2]]) - origin);
        for (const uint32_t c : corner) {
            sums[source.weld[c]] += area;
        }
    }
    for (size_t v = 0; v < positions.size(); ++v) {
        if (!source.normal_missing[v]) continue;
        const glm::dvec3 sum = sums[source.weld[v]];
        normals[v] = unit(mirrored ? -sum : sum);
    }
}

void pose_draw(const Rig& rig, const Draw& draw, Scratch& scratch, std::vector<glm::vec3>& positions,
               std::vector<glm::vec3>& normals) {
    const Source& source = rig.sources[draw.source];
    const size_t count = source.positions.size();
    const std::vector<glm::vec3>* from_positions = &source.positions;
    const std::vector<glm::vec3>* from_normals = &source.normals;
    const std::vector<float>& weights = scratch.weights[static_cast<size_t>(draw.node)];
    const bool morphed = std::any_of(weights.begin(), weights.end(), [](float w) { return w != 0.0f; });
    if (morphed) {
        scratch.positions = source.positions;
        scratch.normals = source.normals;
        for (size_t t = 0; t < std::min(weights.size(), source.targets.size()); ++t) {
            if (weights[t] == 0.0f) continue;
            const MorphTarget& target = source.targets[t];
            for (size_t v = 0; v < target.positions.size(); ++v) {
                scratch.positions[v] += weights[t] * target.positions[v];
            }
            for (size_t v = 0; v < target.normals.size(); ++v) {
                scratch.normals[v] += weights[t] * target.normals[v];
            }
        }
        from_positions = &scratch.positions;
        from_normals = &scratch.normals;
    }

    positions.resize(count);
    normals.resize(count);
    // The inverse transpose is the cofactors over the determinant, so the determinant's sign turns the
    // normal; where it is 0 (a mesh scaled flat), the sign of the rest pose.
    const auto sign = [&](auto determinant) {
        return determinant < 0 ? -1.0 : determinant > 0 ? 1.0 : draw.mirrored ? -1.0 : 1.0;
    };
    if (draw.skin >= 0 && source.influences > 0) {
        pose_palette(rig, draw, scratch);
        for (size_t v = 0; v < count; ++v) {
            const glm::mat4 matrix = blend(source, scratch.palette, v);
            positions[v] = glm::vec3(matrix * glm::vec4((*from_positions)[v], 1.0f));
            const glm::dmat3 linear{glm::mat3(matrix)};
            const glm::dmat3 turned = cofactors(linear);
            const double determinant = glm::dot(linear[0], turned[0]);
            normals[v] = unit(turned * glm::dvec3((*from_normals)[v]) * sign(determinant));
        }
    } else {
        const glm::dmat4& matrix = scratch.worlds[static_cast<size_t>(draw.node)];
        const glm::dmat3 linear(matrix);
        const glm::dmat3 turned = cofactors(linear);
        const double direction = sign(glm::dot(linear[0], turned[0]));
        for (size_t v = 0; v < count; ++v) {
            positions[v] = glm::vec3(glm::dvec3(matrix * glm::dvec4((*from_positions)[v], 1.0)));
            normals[v] = unit(turned * glm::dvec3((*from_normals)[v]) * direction);
        }
    }
    if (!source.normal_missing.empty()) {
        area_normals(source, positions, draw.mirrored, scratch.sums, normals);
    }
}

Scratch& thread_scratch() {
    thread_local Scratch scratch;
    return scratch;
}

// Whether the draw turns the mesh inside out as the nodes stand: most vertices decide for a skinned one.
bool is_mirrored(const Rig& rig, const Draw& draw, Scratch& scratch) {
    const Source& source = rig.sources[draw.source];
    if (draw.skin < 0 || source.influences == 0) {
        return glm::determinant(glm::dmat3(scratch.worlds[static_cast<size_t>(draw.node)])) < 0;
    }
    pose_palette(rig, draw, scratch);
    size_t negative = 0;
    for (size_t v = 0; v < source.positions.size(); ++v) {
        negative += glm::determinant(glm::dmat3(glm::mat3(blend(source, scratch.palette, v)))) < 0;
    }
    return 2 * negative > source.positions.size();
}

bool finite(const glm::vec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

} // namespace

void complete_normals(Source& source) {
    if (std::find(source.normal_missing.begin(), source.normal_missing.end(), 1) ==
        source.normal_missing.end()) {
        source.normal_missing.clear();
        return;
    }
    std::vector<uint32_t> sorted(source.positions.size());
    std::iota(sorted.begin(), sorted.end(), 0u);
    const auto less = [&](uint32_t a, uint32_t b) {
        const glm::vec3 &p = source.positions[a], &q = source.positions[b];
        if (p.x != q.x) return p.x < q.x; // -0 = +0
        if (p.y != q.y) return p.y < q.y;
        if (p.z != q.z) return p.z < q.z;
        return a < b;
    };
    std::sort(sorted.begin(), sorted.end(), less);
    source.weld.resize(sorted.size());
    for (size_t i = 0; i < sorted.size(); ++i) {
        const bool same = i > 0 && source.positions[sorted[i]] == source.positions[sorted[i - 1]];
        source.weld[sorted[i]] = same ? source.weld[sorted[i - 1]] : sorted[i];
    }
    std::vector<glm::dvec3> sums;
    area_normals(source, source.positions, false, sums, source.normals);
}

void add_draw(Model& model, Rig& rig, size_t source_index, int node, int skin, const std::string& name) {
    Draw draw;
    draw.source = source_index;
    draw.node = node;
    draw.skin = skin;
    Scratch& scratch = thread_scratch();
    if (rig.draws.empty()) pose_nodes(rig, nullptr, 0, scratch); // stays right until the rig changes
    draw.mirrored = is_mirrored(rig, draw, scratch);
    rig.draws.push_back(draw);

    const Source& source = rig.sources[source_index];
    scenes::Mesh mesh;
    mesh.name = name;
    mesh.rest_positions = source.positions;
    mesh.rest_normals = source.normals;
    mesh.indices = source.indices;
    mesh.albedo = source.albedo;
    mesh.metallic_roughness = source.metallic_roughness;
    mesh.two_sided = source.two_sided;
    if (draw.mirrored) {
        for (size_t v = 0; v < mesh.rest_positions.size(); ++v) {
            mesh.rest_positions[v].x = -mesh.rest_positions[v].x;
            mesh.rest_normals[v].x = -mesh.rest_normals[v].x;
        }
        for (size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
            std::swap(mesh.indices[i + 1], mesh.indices[i + 2]);
        }
    }
    if (!source.normal_missing.empty()) ++model.meshes_without_normals;
    model.meshes.push_back(std::move(mesh));
}

void finish_model(Model& model, std::shared_ptr<Rig> rig) {
    size_t indices = 0;
    for (const scenes::Mesh& mesh : model.meshes) {
        indices += mesh.indices.size();
    }
    if (indices == 0) fail("NO_TRIANGLES", "", "it has no triangles", "give a file that draws some");
    model.rig = rig;
    scenes::Pose pose;
    make_scene(model, -1).pose(0, pose);
    for (size_t m = 0; m < pose.positions.size(); ++m) {
        const auto& positions = pose.positions[m];
        const auto bad = std::find_if_not(positions.begin(), positions.end(), finite);
        if (bad != positions.end()) {
            fail("POSE_NOT_FINITE", "",
                 "vertex " + std::to_string(bad - positions.begin()) + " of mesh '" +
                     printable(model.meshes[m].name) + "' lands out of range",
                 "check the scales of its nodes");
        }
    }
}

void finish_static(Model& model, Source&& source, const std::string& name) {
    auto rig = std::make_shared<Rig>();
    rig->nodes.resize(1);
    rig->order = {0};
    rig->node_weights.resize(1);
    complete_normals(source);
    model.stored_vertices = source.positions.size();
    model.stored_triangles = source.indices.size() / 3;
    rig->sources.push_back(std::move(source));
    add_draw(model, *rig, 0, 0, -1, name);
    finish_model(model, std::move(rig));
}

scenes::Scene make_scene(const Model& model, int clip) {
    scenes::Scene scene;
    scene.name = model.name;
    scene.meshes = model.meshes;
    const std::shared_ptr<const Rig> rig = model.rig;
    if (!rig) return scene;
    const bool moves = clip >= 0 && static_cast<size_t>(clip) < rig->clips.size();
    const RigClip* moved_by = moves ? &rig->clips[static_cast<size_t>(clip)] : nullptr;
    if (moved_by) scene.duration = moved_by->duration;
    scene.pose = [rig, moved_by](double time, scenes::Pose& pose) {
        Scratch& scratch = thread_scratch();
        const double end = moved_by ? moved_by->duration : 0.0;
        pose_nodes(*rig, moved_by, std::isnan(time) ? 0.0 : std::clamp(time, 0.0, end), scratch);
        pose.positions.resize(rig->draws.size());
        pose.normals.resize(rig->draws.size());
        for (size_t d = 0; d < rig->draws.size(); ++d) {
            pose_draw(*rig, rig->draws[d], scratch, pose.positions[d], pose.normals[d]);
        }
    };
    return scene;
}

} // namespace nusselt::load
