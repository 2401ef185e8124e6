// glTF 2.0 and GLB: from the checked document and its buffers to meshes and a rig.
#include "tools/load/buffers.h"
#include "tools/load/formats.h"
#include "tools/load/rig.h"

#include <glm/gtc/type_ptr.hpp>
#include <glm/matrix.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <set>

namespace nusselt::load {
namespace {

struct Reader {
    Document document;
    Buffers buffers;
    const LoadLimits& limits;
    Model& model;
    bool quantized = false; // KHR_mesh_quantization is named

    const tinygltf::Accessor& accessor(int index) const {
        return document.gltf.accessors[static_cast<size_t>(index)];
    }
    void warn(const char* code, const std::string& text) { load::warn(model.warnings, code, text); }
};

uint32_t little(const Bytes& file, size_t at) {
    return static_cast<uint32_t>(file[at]) | static_cast<uint32_t>(file[at + 1]) << 8 |
           static_cast<uint32_t>(file[at + 2]) << 16 | static_cast<uint32_t>(file[at + 3]) << 24;
}

struct Chunks {
    std::string_view json;
    std::span<const uint8_t> binary; // data() null: none
};

Chunks split_glb(const Bytes& file, std::vector<std::string>& warnings) {
    constexpr uint32_t json_type = 0x4E4F534A, binary_type = 0x004E4942;
    if (file.size() < 12) fail("GLB_TRUNCATED", "", "the GLB header is cut off", file_incomplete);
    if (little(file, 4) != 2) {
        fail("GLB_VERSION", "", "it is GLB version " + std::to_string(little(file, 4)),
             "convert it to glTF 2.0");
    }
    const uint64_t length = little(file, 8);
    if (length > file.size()) {
        fail("GLB_TRUNCATED", "",
             "the GLB says " + std::to_string(length) + " bytes, the file has " + std::to_string(file.size()),
             file_incomplete);
    }
    if (length < file.size()) {
        warn(warnings, "GLB_TRAILING_DATA",
             std::to_string(file.size() - length) + " bytes after the end of the GLB are ignored");
    }
    Chunks chunks;
    bool first = true;
    for (uint64_t at = 12; at < length;) {
        if (length - at < 8)
            fail("GLB_TRUNCATED", "byte " + std::to_string(at), "a chunk is cut off", file_incomplete);
        const uint64_t bytes = little(file, at);
        const uint32_t type = little(file, at + 4);
        if (bytes > length - at - 8) {
            fail("GLB_TRUNCATED", "byte " + std::to_string(at),
                 "a chunk says " + std::to_string(bytes) + " bytes, " + std::to_string(length - at - 8) +
                     " are left",
                 file_incomplete);
        }
        const uint8_t* data = file.data() + at + 8;
        if (first && type != json_type)
            fail("GLB_CHUNK", "", "the first GLB chunk is not JSON", export_again);
        if (!first && type == json_type) fail("GLB_CHUNK", "", "the GLB has two JSON chunks", export_again);
        if (type == json_type)
            chunks.json = {reinterpret_cast<const char*>(data), static_cast<size_t>(bytes)};
        if (type == binary_type && !chunks.binary.data()) chunks.binary = {data, static_cast<size_t>(bytes)};
        first = false;
        at += 8 + bytes;
    }
    if (first) fail("GLB_CHUNK", "", "the GLB has no chunks", file_incomplete);
    return chunks;
}

// T R S of a matrix without shear; a mirror goes into the x scale.
void decompose(RigNode& node) {
    const glm::dmat3 linear(node.matrix);
    node.translation = glm::dvec3(node.matrix[3]);
    node.scale = {glm::length(linear[0]), glm::length(linear[1]), glm::length(linear[2])};
    if (glm::determinant(linear) < 0) node.scale.x = -node.scale.x;
    glm::dmat3 turn(1.0);
    for (int i = 0; i < 3; ++i) {
        if (node.scale[i] != 0) turn[i] = linear[i] / node.scale[i];
    }
    node.rotation = glm::normalize(glm::quat_cast(turn));
}

void read_nodes(Reader& reader, Rig& rig) {
    const std::vector<tinygltf::Node>& nodes = reader.document.gltf.nodes;
    rig.nodes.resize(nodes.size());
    for (size_t i = 0; i < nodes.size(); ++i) {
        const std::string path = "/nodes/" + std::to_string(i);
        for (const int child : nodes[i].children) {
            int& parent = rig.nodes[static_cast<size_t>(child)].parent;
            if (parent >= 0) {
                fail("NODE_PARENT_OVERRIDE", path + "/children",
                     "node " + std::to_string(child) + " has two parents", export_again);
            }
            parent = static_cast<int>(i);
        }
        RigNode& node = rig.nodes[i];
        const tinygltf::Node& given = nodes[i];
        if (given.matrix.size() == 16) {
            node.has_matrix = true;
            node.matrix = glm::make_mat4(given.matrix.data());
            // A projective row has no meaning here, and none in glTF.
            for (int column = 0; column < 4; ++column) {
                node.matrix[column][3] = column == 3 ? 1.0 : 0.0;
            }
            decompose(node);
        }
        if (given.translation.size() == 3) node.translation = glm::make_vec3(given.translation.data());
        if (given.scale.size() == 3) node.scale = glm::make_vec3(given.scale.data());
        if (given.rotation.size() == 4) {
            const glm::dquat q(given.rotation[3], given.rotation[0], given.rotation[1], given.rotation[2]);
            const double length = glm::length(q);
            if (!(std::abs(length - 1) < 1e-3))
                reader.warn("ROTATION_NON_UNIT", path + "/rotation: not a unit quaternion, normalised");
            node.rotation = length > 0 && std::isfinite(length) ? q / length : glm::dquat(1.0, 0.0, 0.0, 0.0);
        }
    }
    // Parents first, level by level; what is never reached hangs in a loop.
    for (size_t i = 0; i < nodes.size(); ++i) {
        if (rig.nodes[i].parent < 0) rig.order.push_back(static_cast<int>(i));
    }
    std::vector<uint32_t> depth(nodes.size(), 1);
    for (size_t done = 0; done < rig.order.size(); ++done) {
        const auto index = static_cast<size_t>(rig.order[done]);
        if (depth[index] > reader.limits.node_depth) {
            fail("LIMIT_NODE_DEPTH", "/nodes/" + std::to_string(index),
                 "the nodes nest deeper than " + std::to_string(reader.limits.node_depth), export_again);
        }
        for (const int child : nodes[index].children) {
            depth[static_cast<size_t>(child)] = depth[index] + 1;
            rig.order.push_back(child);
        }
    }
    if (rig.order.size() < nodes.size()) {
        fail("NODE_LOOP", "/nodes", "a node is its own ancestor", export_again);
    }
}

// Which nodes the scene draws: the default one, else the first, else everything.
std::vector<uint8_t> reachable_nodes(Reader& reader) {
    const tinygltf::Model& gltf = reader.document.gltf;
    if (gltf.scenes.empty()) return std::vector<uint8_t>(gltf.nodes.size(), 1);
    std::vector<uint8_t> reached(gltf.nodes.size(), 0);
    std::vector<int> open = gltf.scenes[static_cast<size_t>(std::max(gltf.defaultScene, 0))].nodes;
    while (!open.empty()) {
        const auto node = static_cast<size_t>(open.back());
        open.pop_back();
        if (reached[node]) continue;
        reached[node] = 1;
        open.insert(open.end(), gltf.nodes[node].children.begin(), gltf.nodes[node].children.end());
    }
    return reached;
}

int attribute(const std::map<std::string, int>& attributes, const char* name) {
    const auto it = attributes.find(name);
    return it == attributes.end() ? -1 : it->second;
}

[[noreturn]] void bad_format(const std::string& path, const char* expected) {
    fail("ACCESSOR_FORMAT", path, std::string("its accessor is not ") + expected, export_again);
}

bool is_float(const tinygltf::Accessor& accessor) {
    return accessor.componentType == TINYGLTF_COMPONENT_TYPE_FLOAT;
}

bool is_small_integer(const tinygltf::Accessor& accessor) {
    return accessor.componentType >= TINYGLTF_COMPONENT_TYPE_BYTE &&
           accessor.componentType <= TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
}

bool is_small_unsigned(const tinygltf::Accessor& accessor) {
    return accessor.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
           accessor.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
}

// One VEC3 a vertex, float or (KHR_mesh_quantization) small integers.
std::vector<glm::vec3> read_vectors(Reader& reader, int index, size_t count, const std::string& path) {
    const tinygltf::Accessor& accessor = reader.accessor(index);
    if (accessor.type != TINYGLTF_TYPE_VEC3 || !(is_float(accessor) || is_small_integer(accessor))) {
        bad_format(path, "a VEC3 of floats or small integers");
    }
    if (accessor.count != count) {
        fail("ATTRIBUTE_COUNT", path,
             std::to_string(accessor.count) + " elements for " + std::to_string(count) + " vertices",
             export_again);
    }
    if (!is_float(accessor) && !reader.quantized) {
        reader.warn("QUANTIZATION_NOT_NAMED", path + ": integers, and KHR_mesh_quantization is not named");
    }
    const std::vector<float> values = read_floats(reader.document, reader.buffers, index);
    std::vector<glm::vec3> out(count);
    for (size_t i = 0; i < count; ++i) {
        out[i] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
    }
    return out;
}

bool finite(const glm::vec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

void check_finite(const std::vector<glm::vec3>& vectors, const std::string& path) {
    for (size_t i = 0; i < vectors.size(); ++i) {
        if (!finite(vectors[i])) {
            fail("POSITION_NOT_FINITE", path, "vertex " + std::to_string(i) + " is not a finite point",
                 export_again);
        }
    }
}

size_t vertex_count(const Reader& reader, const tinygltf::Primitive& primitive) {
    const int position = attribute(primitive.attributes, "POSITION");
    return position < 0 ? 0 : reader.accessor(position).count;
}

// Triangles that the primitive can hold; 0 for points and lines.
size_t triangle_count(const Reader& reader, const tinygltf::Primitive& primitive) {
    if (attribute(primitive.attributes, "POSITION") < 0) return 0;
    const size_t corners =
        primitive.indices >= 0 ? reader.accessor(primitive.indices).count : vertex_count(reader, primitive);
    if (primitive.mode == TINYGLTF_MODE_TRIANGLES) return corners / 3;
    if (primitive.mode == TINYGLTF_MODE_TRIANGLE_STRIP || primitive.mode == TINYGLTF_MODE_TRIANGLE_FAN) {
        return corners < 3 ? 0 : corners - 2;
    }
    return 0;
}

// Triples of vertex numbers below `vertices`; strips and fans taken apart (glTF 2.0, section 3.7.2.1).
std::vector<uint32_t> read_triangles(Reader& reader, const tinygltf::Primitive& primitive, size_t vertices,
                                     const std::string& path) {
    std::vector<uint32_t> corners;
    if (primitive.indices >= 0) {
        const tinygltf::Accessor& accessor = reader.accessor(primitive.indices);
        const bool unsigned_integer =
            is_small_unsigned(accessor) || accessor.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
        if (accessor.type != TINYGLTF_TYPE_SCALAR || !unsigned_integer) {
            bad_format(path + "/indices", "a SCALAR of unsigned integers");
        }
        corners = read_integers(reader.document, reader.buffers, primitive.indices);
        for (size_t i = 0; i < corners.size(); ++i) {
            if (corners[i] >= vertices) {
                fail("ACCESSOR_INDEX_OOB", path + "/indices",
                     "index " + std::to_string(i) + " is " + std::to_string(corners[i]) + ", of " +
                         std::to_string(vertices) + " vertices",
                     export_again);
            }
        }
    } else {
        corners.resize(vertices);
        for (size_t i = 0; i < vertices; ++i) {
            corners[i] = static_cast<uint32_t>(i);
        }
    }

    if (primitive.mode == TINYGLTF_MODE_TRIANGLES) {
        if (corners.size() % 3 != 0) {
            reader.warn("INCOMPLETE_TRIANGLE", path + ": " + std::to_string(corners.size()) +
                                                   " corners, the last triangle is incomplete");
            corners.resize(corners.size() / 3 * 3);
        }
        return corners;
    }
    std::vector<uint32_t> triangles;
    for (size_t i = 0; i + 2 < corners.size(); ++i) {
        const bool fan = primitive.mode == TINYGLTF_MODE_TRIANGLE_FAN;
        const size_t odd = fan ? 0 : i % 2;
        const std::array<uint32_t, 3> corner = {corners[fan ? 0 : i], corners[i + 1 + odd],
                                                corners[i + 2 - odd]};
        // Strips are joined by degenerate triangles that were never meant to be drawn.
        const bool flat = corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0];
        if (fan || !flat) triangles.insert(triangles.end(), corner.begin(), corner.end());
    }
    return triangles;
}

glm::vec3 clamp_colour(glm::vec3 colour) {
    for (int i = 0; i < 3; ++i) {
        colour[i] = colour[i] >= 0.0f ? std::min(colour[i], 1.0f) : 0.0f; // NaN: 0
    }
    return colour;
}

// A set of attributes, shared by primitives that differ in indices and material only.
struct Block {
    size_t begin = 0, count = 0;
    std::vector<int> material;                               // whose triangles use the vertex; -2: none yet
    std::vector<glm::vec3> colour;                           // COLOR_0; empty: white
    std::map<std::pair<int, uint32_t>, uint32_t> duplicates; // (material, vertex): its copy
};

constexpr int no_one = -2;

void read_influences(Reader& reader, const tinygltf::Primitive& primitive, Source& source, const Block& block,
                     const std::string& path) {
    const auto count = static_cast<size_t>(source.influences);
    source.joints.resize(source.positions.size() * count, rigid_joint);
    source.weights.resize(source.positions.size() * count, 0.0f);
    for (size_t v = block.begin; v < block.begin + block.count; ++v) {
        source.weights[v * count] = 1.0f; // rigid, unless replaced below
    }
    bool any = false;
    for (size_t set = 0; set < count / 4; ++set) {
        const std::string joints_name = "JOINTS_" + std::to_string(set),
                          weights_name = "WEIGHTS_" + std::to_string(set);
        const int joints = attribute(primitive.attributes, joints_name.c_str());
        const int weights = attribute(primitive.attributes, weights_name.c_str());
        if (joints < 0 && weights < 0) continue;
        const std::string attributes = path + "/attributes/";
        if (joints < 0 || weights < 0) {
            fail("JOINTS_WEIGHTS_MISMATCH", attributes + (joints < 0 ? weights_name : joints_name),
                 "joints and weights don't come in pairs", export_again);
        }
        const tinygltf::Accessor& joint_accessor = reader.accessor(joints);
        const tinygltf::Accessor& weight_accessor = reader.accessor(weights);
        if (joint_accessor.type != TINYGLTF_TYPE_VEC4 || !is_small_unsigned(joint_accessor)) {
            bad_format(attributes + joints_name, "a VEC4 of unsigned bytes or shorts");
        }
        if (weight_accessor.type != TINYGLTF_TYPE_VEC4 ||
            !(is_float(weight_accessor) ||
              (is_small_unsigned(weight_accessor) && weight_accessor.normalized))) {
            bad_format(attributes + weights_name, "a VEC4 of floats or normalized integers");
        }
        if (joint_accessor.count != block.count || weight_accessor.count != block.count) {
            fail("ATTRIBUTE_COUNT", attributes + joints_name,
                 std::to_string(joint_accessor.count) + " joints and " +
                     std::to_string(weight_accessor.count) + " weights for " + std::to_string(block.count) +
                     " vertices",
                 export_again);
        }
        const std::vector<uint32_t> joint_values = read_integers(reader.document, reader.buffers, joints);
        const std::vector<float> weight_values = read_floats(reader.document, reader.buffers, weights);
        for (size_t v = 0; v < block.count; ++v) {
            for (size_t i = 0; i < 4; ++i) {
                const float weight = weight_values[4 * v + i];
                if (!std::isfinite(weight)) {
                    fail("WEIGHT_NOT_FINITE", attributes + weights_name,
                         "the weight of vertex " + std::to_string(v) + " is not finite", export_again);
                }
                const size_t at = (block.begin + v) * count + 4 * set + i;
                source.joints[at] = static_cast<uint16_t>(joint_values[4 * v + i]);
                source.weights[at] = weight;
            }
        }
        any = true;
    }
    if (!any) return;

    size_t negative = 0, weightless = 0;
    for (size_t v = block.begin; v < block.begin + block.count; ++v) {
        float* weights = source.weights.data() + v * count;
        uint16_t* joints = source.joints.data() + v * count;
        double sum = 0;
        for (size_t i = 0; i < count; ++i) {
            negative += weights[i] < 0.0f;
            weights[i] = std::max(weights[i], 0.0f);
            sum += static_cast<double>(weights[i]);
        }
        if (!(sum > 0)) {
            ++weightless;
            std::fill_n(joints, count, rigid_joint);
            weights[0] = 1.0f;
            continue;
        }
        for (size_t i = 0; i < count; ++i) {
            weights[i] = static_cast<float>(static_cast<double>(weights[i]) / sum);
            if (weights[i] == 0.0f) {
                joints[i] = 0;
            } else {
                source.joint_count = std::max<uint32_t>(source.joint_count, joints[i] + 1u);
            }
        }
    }
    if (negative > 0)
        reader.warn("NEGATIVE_WEIGHTS",
                    path + ": " + std::to_string(negative) + " negative weights are taken as 0");
    if (weightless > 0) {
        reader.warn("NO_WEIGHTS",
                    path + ": " + std::to_string(weightless) + " vertices without weights follow their node");
    }
}

// Reads the attributes of a primitive behind the source's vertices.
Block read_block(Reader& reader, const tinygltf::Primitive& primitive, Source& source,
                 const std::string& path) {
    Block block;
    block.begin = source.positions.size();
    block.count = vertex_count(reader, primitive);
    block.material.assign(block.count, no_one);
    const std::string attributes = path + "/attributes/";

    const std::vector<glm::vec3> positions = read_vectors(reader, attribute(primitive.attributes, "POSITION"),
                                                          block.count, attributes + "POSITION");
    check_finite(positions, attributes + "POSITION");
    source.positions.insert(source.positions.end(), positions.begin(), positions.end());

    source.normals.resize(source.positions.size(), glm::vec3(0.0f, 1.0f, 0.0f));
    source.normal_missing.resize(source.positions.size(), 1);
    if (const int normal = attribute(primitive.attributes, "NORMAL"); normal >= 0) {
        const std::vector<glm::vec3> normals =
            read_vectors(reader, normal, block.count, attributes + "NORMAL");
        size_t bad = 0, skewed = 0;
        for (size_t i = 0; i < block.count; ++i) {
            const glm::dvec3 n(normals[i]);
            const double length = glm::length(n);
            if (!finite(normals[i]) || !(length > 1e-12)) {
                ++bad;
                continue;
            }
            skewed += std::abs(length - 1) > 0.02; // bytes are that coarse
            source.normals[block.begin + i] = glm::vec3(n / length);
            source.normal_missing[block.begin + i] = 0;
        }
        if (bad > 0)
            reader.warn("NORMAL_ZERO",
                        attributes + "NORMAL: " + std::to_string(bad) + " of no direction are computed");
        if (skewed > 0)
            reader.warn("NORMAL_NON_UNIT",
                        attributes + "NORMAL: " + std::to_string(skewed) + " not of unit length, normalised");
    }

    if (const int colour = attribute(primitive.attributes, "COLOR_0"); colour >= 0) {
        const tinygltf::Accessor& accessor = reader.accessor(colour);
        const bool known = (accessor.type == TINYGLTF_TYPE_VEC3 || accessor.type == TINYGLTF_TYPE_VEC4) &&
                           (is_float(accessor) || (is_small_unsigned(accessor) && accessor.normalized)) &&
                           accessor.count == block.count;
        if (known) {
            const auto width = static_cast<size_t>(component_count(accessor));
            const std::vector<float> values = read_floats(reader.document, reader.buffers, colour);
            for (size_t i = 0; i < block.count; ++i) {
                block.colour.emplace_back(values[width * i], values[width * i + 1], values[width * i + 2]);
            }
        } else {
            reader.warn("COLOR_FORMAT", attributes + "COLOR_0: not a colour a vertex, ignored");
        }
    }
    source.albedo.resize(source.positions.size(), glm::vec3(1.0f));
    source.metallic_roughness.resize(source.positions.size(), glm::vec2(1.0f)); // glTF's default
    source.two_sided.resize(source.positions.size(), 0);

    if (source.influences > 0) read_influences(reader, primitive, source, block, path);

    for (size_t t = 0; t < source.targets.size(); ++t) {
        MorphTarget& target = source.targets[t];
        const auto deltas = [&](const char* name, std::vector<glm::vec3>& out) {
            const int index = t < primitive.targets.size() ? attribute(primitive.targets[t], name) : -1;
            if (index < 0 && out.empty()) return;
            out.resize(block.begin, glm::vec3(0.0f)); // primitives before this one had none
            if (index >= 0) {
                const std::string target_path = path + "/targets/" + std::to_string(t) + "/" + name;
                const std::vector<glm::vec3> values = read_vectors(reader, index, block.count, target_path);
                check_finite(values, target_path);
                out.insert(out.end(), values.begin(), values.end());
            }
            out.resize(source.positions.size(), glm::vec3(0.0f));
        };
        deltas("POSITION", target.positions);
        deltas("NORMAL", target.normals);
    }
    return block;
}

float clamp_unit(double factor) {
    return factor >= 0 ? static_cast<float>(std::min(factor, 1.0)) : 0.0f; // NaN: 0
}

// A copy of vertex v at the end of every array.
uint32_t duplicate(Source& source, size_t v) {
    const auto copy = static_cast<uint32_t>(source.positions.size());
    source.positions.push_back(source.positions[v]);
    source.normals.push_back(source.normals[v]);
    source.normal_missing.push_back(source.normal_missing[v]);
    source.albedo.push_back(source.albedo[v]);
    source.metallic_roughness.push_back(source.metallic_roughness[v]);
    source.two_sided.push_back(source.two_sided[v]);
    for (size_t i = 0; i < source.influences; ++i) {
        source.joints.push_back(source.joints[v * source.influences + i]);
        source.weights.push_back(source.weights[v * source.influences + i]);
    }
    for (MorphTarget& target : source.targets) {
        for (std::vector<glm::vec3>* deltas : {&target.positions, &target.normals}) {
            if (v < deltas->size()) {
                deltas->resize(copy, glm::vec3(0.0f));
                deltas->push_back((*deltas)[v]);
            }
        }
    }
    return copy;
}

Source read_mesh(Reader& reader, size_t mesh_index) {
    const tinygltf::Model& gltf = reader.document.gltf;
    const tinygltf::Mesh& mesh = gltf.meshes[mesh_index];
    const std::string mesh_path = "/meshes/" + std::to_string(mesh_index);
    Source source;
    size_t targets = 0;
    bool uneven = false;
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
        uneven = uneven || primitive.targets.size() != mesh.primitives.front().targets.size();
        targets = std::max(targets, primitive.targets.size());
        const bool first = attribute(primitive.attributes, "JOINTS_0") >= 0;
        const bool second = attribute(primitive.attributes, "JOINTS_1") >= 0;
        source.influences = std::max(source.influences, second ? 8u : first ? 4u : 0u);
        if (attribute(primitive.attributes, "JOINTS_2") >= 0) {
            reader.warn("TOO_MANY_INFLUENCES",
                        mesh_path + ": more than 8 influences a vertex, the first 8 are used");
        }
    }
    if (uneven)
        reader.warn("UNEQUAL_TARGETS",
                    mesh_path + ": primitives with fewer morph targets than others stay as they are");
    source.targets.resize(targets);
    source.target_weights.assign(mesh.weights.begin(), mesh.weights.end());
    if (!mesh.weights.empty() && mesh.weights.size() != targets) {
        reader.warn("WEIGHTS_COUNT", mesh_path + "/weights: " + std::to_string(mesh.weights.size()) +
                                         " for " + std::to_string(targets) + " morph targets");
    }
    source.target_weights.resize(targets, 0.0f);

    std::map<std::vector<std::map<std::string, int>>, Block> blocks;
    for (size_t p = 0; p < mesh.primitives.size(); ++p) {
        const tinygltf::Primitive& primitive = mesh.primitives[p];
        const std::string path = mesh_path + "/primitives/" + std::to_string(p);
        if (primitive.mode < TINYGLTF_MODE_TRIANGLES) {
            reader.warn("POINTS_OR_LINES", path + ": points and lines are not drawn");
            continue;
        }
        if (attribute(primitive.attributes, "POSITION") < 0) {
            reader.warn("NO_POSITIONS", path + ": no positions, not drawn");
            continue;
        }
        std::vector<std::map<std::string, int>> key = primitive.targets;
        key.push_back(primitive.attributes);
        auto it = blocks.find(key);
        if (it == blocks.end()) it = blocks.emplace(key, read_block(reader, primitive, source, path)).first;
        Block& block = it->second;

        glm::vec3 base(1.0f);
        glm::vec2 gloss(1.0f);
        uint8_t two_sided = 0;
        if (primitive.material >= 0) {
            const tinygltf::Material& material = gltf.materials[static_cast<size_t>(primitive.material)];
            const tinygltf::PbrMetallicRoughness& pbr = material.pbrMetallicRoughness;
            two_sided = material.doubleSided;
            gloss = {clamp_unit(pbr.metallicFactor), clamp_unit(pbr.roughnessFactor)};
            const std::vector<double>& factor = pbr.baseColorFactor;
            if (factor.size() == 4) base = glm::vec3(glm::dvec3(factor[0], factor[1], factor[2]));
        }
        for (const uint32_t corner : read_triangles(reader, primitive, block.count, path)) {
            auto vertex = static_cast<uint32_t>(block.begin + corner);
            const glm::vec3 colour = clamp_colour(block.colour.empty() ? base : base * block.colour[corner]);
            const auto paint = [&](uint32_t v) {
                source.albedo[v] = colour;
                source.metallic_roughness[v] = gloss;
                source.two_sided[v] = two_sided;
            };
            const auto is_painted = [&](uint32_t v) {
                return source.albedo[v] == colour && source.metallic_roughness[v] == gloss &&
                       source.two_sided[v] == two_sided;
            };
            int& owner = block.material[corner];
            if (owner == no_one) {
                owner = primitive.material;
                paint(vertex);
            } else if (owner != primitive.material && !is_painted(vertex)) {
                // Materials are by vertex, so another one needs another vertex.
                const auto [copy, added] = block.duplicates.try_emplace({primitive.material, corner}, 0u);
                if (added) {
                    copy->second = duplicate(source, vertex);
                    paint(copy->second);
                }
                vertex = copy->second;
            }
            source.indices.push_back(vertex);
        }
    }
    for (MorphTarget& target : source.targets) {
        for (std::vector<glm::vec3>* deltas : {&target.positions, &target.normals}) {
            if (!deltas->empty()) deltas->resize(source.positions.size(), glm::vec3(0.0f));
        }
    }
    complete_normals(source);
    return source;
}

void read_skins(Reader& reader, Rig& rig) {
    for (size_t s = 0; s < reader.document.gltf.skins.size(); ++s) {
        const tinygltf::Skin& given = reader.document.gltf.skins[s];
        const std::string path = "/skins/" + std::to_string(s) + "/inverseBindMatrices";
        RigSkin skin;
        skin.joints = given.joints;
        skin.inverse_bind.assign(given.joints.size(), glm::dmat4(1.0));
        if (given.inverseBindMatrices >= 0) {
            const tinygltf::Accessor& accessor = reader.accessor(given.inverseBindMatrices);
            if (accessor.type != TINYGLTF_TYPE_MAT4 || !is_float(accessor))
                bad_format(path, "a MAT4 of floats");
            if (accessor.count < given.joints.size()) {
                fail("SKIN_MATRICES", path,
                     std::to_string(accessor.count) + " matrices for " + std::to_string(given.joints.size()) +
                         " joints",
                     export_again);
            }
            const std::vector<float> values =
                read_floats(reader.document, reader.buffers, given.inverseBindMatrices);
            for (size_t j = 0; j < skin.joints.size(); ++j) {
                for (int k = 0; k < 16; ++k) {
                    const float value = values[16 * j + static_cast<size_t>(k)];
                    if (!std::isfinite(value)) {
                        fail("SKIN_MATRICES", path, "matrix " + std::to_string(j) + " is not finite",
                             export_again);
                    }
                    skin.inverse_bind[j][k / 4][k % 4] = k % 4 != 3 ? static_cast<double>(value)
                                                         : k == 15  ? 1.0
                                                                    : 0.0;
                }
            }
        }
        rig.skins.push_back(std::move(skin));
    }
}

std::vector<float> read_times(Reader& reader, int index, const std::string& path) {
    const tinygltf::Accessor& accessor = reader.accessor(index);
    if (accessor.type != TINYGLTF_TYPE_SCALAR || !is_float(accessor)) bad_format(path, "a SCALAR of floats");
    std::vector<float> times = read_floats(reader.document, reader.buffers, index);
    bool repeated = false;
    for (size_t k = 0; k < times.size(); ++k) {
        const bool falls = k > 0 && !(times[k] >= times[k - 1]);
        if (!std::isfinite(times[k]) || falls || times[k] < 0) {
            fail("ANIMATION_TIMES", path, "the time of key " + std::to_string(k) + " is not a later one",
                 export_again);
        }
        repeated = repeated || (k > 0 && times[k] == times[k - 1]);
    }
    if (repeated) reader.warn("REPEATED_KEY", path + ": two keys at one time, the later one counts");
    return times;
}

Track read_track(Reader& reader, const Rig& rig, const tinygltf::AnimationChannel& channel,
                 const tinygltf::AnimationSampler& sampler, const std::string& path) {
    Track track;
    track.node = channel.target_node;
    track.interpolation = sampler.interpolation == "STEP"          ? Interpolation::step
                          : sampler.interpolation == "CUBICSPLINE" ? Interpolation::cubic
                                                                   : Interpolation::linear;
    int type = TINYGLTF_TYPE_VEC3;
    size_t width = 3, elements = 1; // elements of the output a value
    if (channel.target_path == "rotation") {
        track.path = Path::rotation;
        type = TINYGLTF_TYPE_VEC4;
        width = 4;
    } else if (channel.target_path == "scale") {
        track.path = Path::scale;
    } else if (channel.target_path == "weights") {
        track.path = Path::weights;
        type = TINYGLTF_TYPE_SCALAR;
        width = elements = rig.node_weights[static_cast<size_t>(track.node)].size();
        if (width == 0) return track; // nothing to move
    }
    track.width = static_cast<uint32_t>(width);
    track.times = read_times(reader, sampler.input, path + "/input");

    const tinygltf::Accessor& output = reader.accessor(sampler.output);
    const bool number = is_float(output) || (is_small_integer(output) && output.normalized);
    if (output.type != type || !number) {
        bad_format(path + "/output", type == TINYGLTF_TYPE_VEC4 ? "a VEC4 of floats or normalized integers"
                                     : type == TINYGLTF_TYPE_VEC3
                                         ? "a VEC3 of floats"
                                         : "a SCALAR of floats or normalized integers");
    }
    const uint64_t tangents = track.interpolation == Interpolation::cubic ? 3 : 1;
    const uint64_t wanted = static_cast<uint64_t>(track.times.size()) * elements * tangents;
    if (output.count != wanted) {
        fail("ANIMATION_OUTPUT_COUNT", path + "/output",
             std::to_string(output.count) + " values, " + std::to_string(track.times.size()) + " keys need " +
                 std::to_string(wanted),
             export_again);
    }
    track.values = read_floats(reader.document, reader.buffers, sampler.output);
    for (size_t i = 0; i < track.values.size(); ++i) {
        if (!std::isfinite(track.values[i])) {
            fail("ANIMATION_NOT_FINITE", path + "/output", "value " + std::to_string(i) + " is not finite",
                 export_again);
        }
    }
    return track;
}

void read_animations(Reader& reader, Rig& rig) {
    const tinygltf::Model& gltf = reader.document.gltf;
    for (size_t a = 0; a < gltf.animations.size(); ++a) {
        const tinygltf::Animation& animation = gltf.animations[a];
        const std::string path = "/animations/" + std::to_string(a);
        RigClip clip;
        Clip described;
        described.name = clean_name(animation.name);
        std::set<std::string> paths;
        std::set<std::pair<int, std::string>> moved;
        for (const tinygltf::AnimationChannel& channel : animation.channels) {
            const std::string sampler_path = path + "/samplers/" + std::to_string(channel.sampler);
            Track track = read_track(reader, rig, channel,
                                     animation.samplers[static_cast<size_t>(channel.sampler)], sampler_path);
            paths.insert(channel.target_path);
            if (!moved.emplace(channel.target_node, channel.target_path).second) {
                reader.warn("REPEATED_CHANNEL", path + ": node " + std::to_string(channel.target_node) +
                                                    " has two channels for its " + channel.target_path +
                                                    ", the last one counts");
            }
            if (track.times.empty()) {
                reader.warn("NO_TARGETS", path + ": weights for a node without morph targets");
                continue;
            }
            clip.duration = std::max(clip.duration, static_cast<double>(track.times.back()));
            clip.tracks.push_back(std::move(track));
        }
        for (const int input : reader.document.pointer_inputs[a]) {
            paths.insert("pointer");
            const std::vector<float> times = read_times(reader, input, path);
            if (!times.empty()) clip.duration = std::max(clip.duration, static_cast<double>(times.back()));
        }
        if (!reader.document.pointer_inputs[a].empty()) {
            reader.warn("ANIMATION_POINTER", path + ": channels of KHR_animation_pointer are not played");
        }
        described.duration = clip.duration;
        described.paths.assign(paths.begin(), paths.end());
        rig.clips.push_back(std::move(clip));
        reader.model.clips.push_back(std::move(described));
    }
}

void count_contents(Reader& reader) {
    const tinygltf::Model& gltf = reader.document.gltf;
    Model& model = reader.model;
    model.generator = clean_name(gltf.asset.generator);
    for (const std::string& name : gltf.extensionsUsed) {
        model.extensions.push_back(printable(name));
    }
    model.nodes = gltf.nodes.size();
    model.materials = gltf.materials.size();
    model.skins = gltf.skins.size();
    for (const tinygltf::Skin& skin : gltf.skins) {
        model.joints = std::max(model.joints, skin.joints.size());
    }
    std::set<int> positions;
    for (const tinygltf::Mesh& mesh : gltf.meshes) {
        for (const tinygltf::Primitive& primitive : mesh.primitives) {
            model.stored_triangles += triangle_count(reader, primitive);
            model.morph_targets = std::max(model.morph_targets, primitive.targets.size());
            const int position = attribute(primitive.attributes, "POSITION");
            if (position >= 0 && positions.insert(position).second) {
                model.stored_vertices += reader.accessor(position).count;
            }
        }
    }
}

struct Drawn {
    int node;
    size_t mesh;
};

// Joints that glTF forbids and that pose a mesh all the same: of a scene that does not draw them, or of trees
// with nothing in common. `root`: of each node's tree.
void warn_of_joints(Reader& reader, int node, const std::vector<uint8_t>& reachable,
                    const std::vector<int>& root) {
    const tinygltf::Model& gltf = reader.document.gltf;
    const int skin = gltf.nodes[static_cast<size_t>(node)].skin;
    if (skin < 0) return;
    const std::vector<int>& joints = gltf.skins[static_cast<size_t>(skin)].joints;
    for (const int joint : joints) {
        if (reachable[static_cast<size_t>(joint)]) continue;
        reader.warn("NODE_SKIN_NO_SCENE", "/nodes/" + std::to_string(node) + "/skin: joint node " +
                                              std::to_string(joint) + " is not in the scene, it counts");
        break;
    }
    for (const int joint : joints) {
        if (root[static_cast<size_t>(joint)] == root[static_cast<size_t>(joints[0])]) continue;
        reader.warn("SKIN_NO_COMMON_ROOT", "/skins/" + std::to_string(skin) + "/joints: nodes " +
                                               std::to_string(joints[0]) + " and " + std::to_string(joint) +
                                               " have no common root, each follows its own");
        break;
    }
}

// The nodes that draw, and a proof that what they draw together is within limits.
std::vector<Drawn> drawn_nodes(Reader& reader, const Rig& rig) {
    const tinygltf::Model& gltf = reader.document.gltf;
    std::vector<Drawn> drawn;
    const std::vector<uint8_t> reachable = reachable_nodes(reader);
    std::vector<int> root(gltf.nodes.size());
    for (const int n : rig.order) { // parents come first
        const int parent = rig.nodes[static_cast<size_t>(n)].parent;
        root[static_cast<size_t>(n)] = parent < 0 ? n : root[static_cast<size_t>(parent)];
    }
    for (size_t n = 0; n < gltf.nodes.size(); ++n) {
        if (reachable[n] && gltf.nodes[n].mesh >= 0) {
            drawn.push_back({static_cast<int>(n), static_cast<size_t>(gltf.nodes[n].mesh)});
            warn_of_joints(reader, static_cast<int>(n), reachable, root);
        }
    }
    uint64_t vertices = 0, triangles = 0;
    for (const Drawn& d : drawn) {
        for (const tinygltf::Primitive& primitive : gltf.meshes[d.mesh].primitives) {
            // Counts are below 2^53 each, and the check stops at the first that is too much: no overflow.
            vertices += vertex_count(reader, primitive);
            triangles += triangle_count(reader, primitive);
            if (vertices > reader.limits.vertices || triangles > reader.limits.triangles) {
                const bool v = vertices > reader.limits.vertices;
                fail(v ? "LIMIT_VERTICES" : "LIMIT_TRIANGLES", "/meshes/" + std::to_string(d.mesh),
                     "more than " + std::to_string(v ? reader.limits.vertices : reader.limits.triangles) +
                         (v ? " vertices" : " triangles") + " are drawn",
                     "raise the limit if you trust it");
            }
        }
    }
    return drawn;
}

} // namespace

Model read_gltf(const std::string& path, Bytes file, const LoadLimits& limits) {
    Model model;
    Chunks chunks;
    const bool binary = file.size() >= 4 && std::memcmp(file.data(), "glTF", 4) == 0;
    model.format = binary ? "GLB" : "glTF";
    if (binary) {
        chunks = split_glb(file, model.warnings);
    } else {
        chunks.json = {reinterpret_cast<const char*>(file.data()), file.size()};
    }
    // Some writers pad with zero bytes where the format wants blanks.
    while (!chunks.json.empty() && chunks.json.back() == '\0') {
        chunks.json.remove_suffix(1);
    }
    Reader reader{read_document(chunks.json, limits), {}, limits, model};
    if (!binary) file = Bytes(); // the document has its own copy
    reader.buffers = read_buffers(reader.document, path, chunks.binary, limits);
    model.warnings.insert(model.warnings.end(), reader.document.warnings.begin(),
                          reader.document.warnings.end());
    tinygltf::Model& gltf = reader.document.gltf;
    reader.quantized =
        std::count(gltf.extensionsUsed.begin(), gltf.extensionsUsed.end(), "KHR_mesh_quantization") > 0;
    if (gltf.nodes.empty() && !gltf.meshes.empty()) {
        reader.warn("NO_NODES", "no nodes: each mesh is drawn once, where it is");
        gltf.nodes.resize(gltf.meshes.size());
        for (size_t m = 0; m < gltf.meshes.size(); ++m) {
            gltf.nodes[m].mesh = static_cast<int>(m);
        }
        gltf.scenes.clear();
    }
    count_contents(reader);

    auto rig = std::make_shared<Rig>();
    read_nodes(reader, *rig);
    read_skins(reader, *rig);
    std::map<size_t, size_t> sources; // mesh to source
    const std::vector<Drawn> drawn = drawn_nodes(reader, *rig);
    for (const Drawn& d : drawn) {
        if (sources.try_emplace(d.mesh, rig->sources.size()).second)
            rig->sources.push_back(read_mesh(reader, d.mesh));
    }

    rig->node_weights.resize(gltf.nodes.size());
    for (const Drawn& d : drawn) {
        const Source& source = rig->sources[sources[d.mesh]];
        std::vector<float>& weights = rig->node_weights[static_cast<size_t>(d.node)];
        weights = source.target_weights;
        const std::vector<double>& given = gltf.nodes[static_cast<size_t>(d.node)].weights;
        for (size_t i = 0; i < std::min(given.size(), weights.size()); ++i) {
            weights[i] = static_cast<float>(given[i]);
        }
    }
    for (const Drawn& d : drawn) {
        const tinygltf::Node& node = gltf.nodes[static_cast<size_t>(d.node)];
        const size_t source_index = sources[d.mesh];
        const Source& source = rig->sources[source_index];
        if (source.indices.empty()) continue;
        if (node.skin >= 0 && source.joint_count > rig->skins[static_cast<size_t>(node.skin)].joints.size()) {
            fail("JOINT_OOB", "/nodes/" + std::to_string(d.node) + "/skin",
                 "mesh " + std::to_string(d.mesh) + " uses joint " + std::to_string(source.joint_count - 1) +
                     " of " + std::to_string(rig->skins[static_cast<size_t>(node.skin)].joints.size()),
                 export_again);
        }
        if (node.skin >= 0 && source.influences == 0) {
            reader.warn("NO_JOINTS", "/nodes/" + std::to_string(d.node) +
                                         "/skin: its mesh has no joints, it follows the node");
        }
        std::string name = clean_name(node.name);
        if (name.empty()) name = clean_name(gltf.meshes[d.mesh].name);
        if (name.empty()) name = "mesh " + std::to_string(d.mesh);
        add_draw(model, *rig, source_index, d.node, node.skin, name);
    }
    read_animations(reader, *rig);
    finish_model(model, std::move(rig));
    return model;
}

} // namespace nusselt::load
