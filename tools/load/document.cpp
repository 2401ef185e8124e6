#include "tools/load/document.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>

namespace nusselt::load {
namespace {

using json = nlohmann::json;

constexpr uint64_t largest_index = 0x7FFFFFFF; // tinygltf keeps indices in int
constexpr uint64_t largest_size = 1ull << 53;  // the largest whole number that JSON readers agree on
constexpr size_t longest_string = 1u << 20;

// Counts while the text is read, before a document is built from it. Iterative, so depth can't exhaust the
// stack.
struct Scan {
    explicit Scan(const LoadLimits& given) : limits(given) {}

    const LoadLimits& limits;
    uint64_t tokens = 0;
    uint64_t uri_bytes = 0;
    uint32_t depth = 0;
    bool uri_array = false; // inside /buffers or /images
    bool uri_value = false; // the next value is /buffers/N/uri or /images/N/uri

    bool token() {
        if (++tokens > limits.json_tokens) {
            fail("LIMIT_JSON", "", "the JSON has more than " + std::to_string(limits.json_tokens) + " values",
                 "raise the limit if you trust it");
        }
        return true;
    }
    bool open() {
        if (++depth > limits.json_depth) {
            fail("LIMIT_JSON", "",
                 "the JSON nests deeper than " + std::to_string(limits.json_depth) + " levels", export_again);
        }
        return token();
    }
    bool close() {
        --depth;
        return true;
    }

    bool null() { return token(); }
    bool boolean(bool) { return token(); }
    bool number_integer(json::number_integer_t) { return token(); }
    bool number_unsigned(json::number_unsigned_t) { return token(); }
    bool number_float(json::number_float_t, const json::string_t&) { return token(); }
    bool binary(json::binary_t&) { return token(); }
    bool string(json::string_t& value) {
        const uint64_t longest = uri_value ? limits.data_uri_bytes : longest_string;
        if (value.size() > longest) {
            fail("LIMIT_JSON", "", "the JSON has a string of " + std::to_string(value.size()) + " bytes",
                 "keep large data in a file of its own");
        }
        if (uri_value) uri_bytes += value.size();
        return token();
    }
    bool start_object(size_t) { return open(); }
    bool end_object() { return close(); }
    bool start_array(size_t) { return open(); }
    bool end_array() { return close(); }
    bool key(json::string_t& name) {
        if (depth == 1) uri_array = name == "buffers" || name == "images";
        uri_value = depth == 3 && uri_array && name == "uri";
        if (name.size() > longest_string) {
            fail("LIMIT_JSON", "", "the JSON has a name of " + std::to_string(name.size()) + " bytes",
                 export_again);
        }
        return true;
    }
    bool parse_error(size_t position, const std::string&, const nlohmann::detail::exception&) {
        fail("INVALID_JSON", "byte " + std::to_string(position), "the JSON is not valid", export_again);
    }
};

// Copies properties from the file's document to the reduced one, each checked.
struct Copier {
    const json& root;

    static std::string below(const std::string& path, const std::string& name) { return path + "/" + name; }

    [[noreturn]] static void mismatch(const std::string& path, const char* expected) {
        fail("TYPE_MISMATCH", path, std::string("expected ") + expected, export_again);
    }

    size_t size(const char* array) const {
        const auto it = root.find(array);
        return it == root.end() ? 0 : it->size();
    }

    // The property, or null where it is absent and need not be there.
    static const json* find(const json& in, const std::string& path, const char* name, bool required) {
        const auto it = in.find(name);
        if (it != in.end()) return &*it;
        if (required)
            fail("UNDEFINED_PROPERTY", path, std::string("'") + name + "' is missing", export_again);
        return nullptr;
    }

    static uint64_t whole(const json& value, const std::string& path, uint64_t largest) {
        double number = -1;
        if (value.is_number_unsigned()) {
            const auto unsigned_value = value.get<uint64_t>();
            if (unsigned_value <= largest) return unsigned_value;
        } else if (value.is_number_float()) { // "4.0" is a whole number too
            number = value.get<double>();
        } else if (!value.is_number()) {
            mismatch(path, "a whole number");
        }
        if (!(number >= 0 && number <= static_cast<double>(largest)) || number != std::floor(number)) {
            fail("VALUE_NOT_IN_RANGE", path,
                 "the number is not a whole one from 0 to " + std::to_string(largest), export_again);
        }
        return static_cast<uint64_t>(number);
    }

    uint64_t reference(const json& value, const std::string& path, const char* array) const {
        const uint64_t index = whole(value, path, largest_index);
        if (index >= size(array)) {
            fail("UNRESOLVED_REFERENCE", path,
                 "number " + std::to_string(index) + " of " + std::to_string(size(array)) + " " + array,
                 export_again);
        }
        return index;
    }

    static void whole(const json& in, json& out, const std::string& path, const char* name, uint64_t largest,
                      bool required = false) {
        if (const json* value = find(in, path, name, required)) {
            out[name] = whole(*value, below(path, name), largest);
        }
    }

    void reference(const json& in, json& out, const std::string& path, const char* name, const char* array,
                   bool required = false) const {
        if (const json* value = find(in, path, name, required)) {
            out[name] = reference(*value, below(path, name), array);
        }
    }

    void references(const json& in, json& out, const std::string& path, const char* name, const char* array,
                    bool required = false) const {
        if (const json* value = find(in, path, name, required)) {
            if (!value->is_array()) mismatch(below(path, name), "an array");
            json list = json::array();
            for (size_t i = 0; i < value->size(); ++i) {
                list.push_back(reference((*value)[i], below(path, name) + "/" + std::to_string(i), array));
            }
            out[name] = std::move(list);
        }
    }

    // length 0: any.
    static void numbers(const json& in, json& out, const std::string& path, const char* name, size_t length) {
        if (const json* value = find(in, path, name, false)) {
            const bool fits =
                value->is_array() && (length == 0 || value->size() == length) &&
                std::all_of(value->begin(), value->end(), [](const json& v) { return v.is_number(); });
            if (!fits) {
                mismatch(below(path, name), length == 0   ? "an array of numbers"
                                            : length == 3 ? "an array of 3 numbers"
                                            : length == 4 ? "an array of 4 numbers"
                                                          : "an array of 16 numbers");
            }
            // A float can't hold more, and the square of a scale must not overflow a double.
            for (const json& v : *value) {
                if (!(std::abs(v.get<double>()) <= 3.4e38)) {
                    fail("VALUE_NOT_IN_RANGE", below(path, name), "a number is out of range", export_again);
                }
            }
            out[name] = *value;
        }
    }

    static void text(const json& in, json& out, const std::string& path, const char* name,
                     bool required = false) {
        if (const json* value = find(in, path, name, required)) {
            if (!value->is_string()) mismatch(below(path, name), "a string");
            out[name] = *value;
        }
    }

    static void number(const json& in, json& out, const std::string& path, const char* name) {
        if (const json* value = find(in, path, name, false)) {
            if (!value->is_number()) mismatch(below(path, name), "a number");
            out[name] = *value;
        }
    }

    static void flag(const json& in, json& out, const std::string& path, const char* name) {
        if (const json* value = find(in, path, name, false)) {
            if (!value->is_boolean()) mismatch(below(path, name), "true or false");
            out[name] = *value;
        }
    }

    static void one_of(const json& in, const std::string& path, const char* name,
                       std::initializer_list<const char*> allowed) {
        const std::string& value = in.find(name)->get_ref<const std::string&>();
        if (std::none_of(allowed.begin(), allowed.end(), [&](const char* a) { return value == a; })) {
            fail("VALUE_NOT_IN_LIST", below(path, name),
                 "'" + printable(value) + "' is not a value of glTF 2.0", export_again);
        }
    }

    // Calls element(object, path) for each element of in[name].
    template<class Element>
    static void each(const json& in, const std::string& path, const char* name, bool required,
                     Element element) {
        const json* value = find(in, path, name, required);
        if (!value) return;
        const std::string array_path = below(path, name);
        if (!value->is_array()) mismatch(array_path, "an array");
        for (size_t i = 0; i < value->size(); ++i) {
            const std::string element_path = below(array_path, std::to_string(i));
            if (!(*value)[i].is_object()) mismatch(element_path, "an object");
            element((*value)[i], element_path);
        }
    }

    static const json* object(const json& in, const std::string& path, const char* name,
                              bool required = false) {
        const json* value = find(in, path, name, required);
        if (value && !value->is_object()) mismatch(below(path, name), "an object");
        return value;
    }

    static const json* extension(const json& in, const std::string& path, const char* name) {
        const json* extensions = object(in, path, "extensions");
        return extensions ? object(*extensions, below(path, "extensions"), name) : nullptr;
    }
};

void component_type(const json& in, const std::string& path) {
    const uint64_t type = in.at("componentType").get<uint64_t>();
    if (type < 5120 || type > 5126 || type == 5124) {
        fail("VALUE_NOT_IN_LIST", path + "/componentType",
             "component type " + std::to_string(type) + " does not exist", export_again);
    }
}

// The bounds that a file gives, where they are as many numbers as an element has: buffers.cpp compares them.
void copy_bounds(const json& in, json& accessor) {
    for (const char* name : {"min", "max"}) {
        const auto it = in.find(name);
        const bool fits =
            it != in.end() && it->is_array() && it->size() <= 16 &&
            std::all_of(it->begin(), it->end(), [](const json& value) { return value.is_number(); });
        if (fits) accessor[name] = *it;
    }
}

json copy_accessors(const Copier& copy, Document& document) {
    json out = json::array();
    Copier::each(copy.root, "", "accessors", false, [&](const json& in, const std::string& path) {
        json accessor = json::object();
        copy.reference(in, accessor, path, "bufferView", "bufferViews");
        Copier::whole(in, accessor, path, "byteOffset", largest_size);
        Copier::whole(in, accessor, path, "componentType", largest_index, true);
        component_type(accessor, path);
        Copier::whole(in, accessor, path, "count", largest_size, true);
        if (accessor["count"] == 0)
            fail("VALUE_NOT_IN_RANGE", path + "/count", "an accessor is empty", export_again);
        Copier::text(in, accessor, path, "type", true);
        Copier::one_of(accessor, path, "type", {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"});
        Copier::flag(in, accessor, path, "normalized");
        copy_bounds(in, accessor);
        if (Copier::extension(in, path, "KHR_mesh_quantization")) {
            warn(document.warnings, "UNEXPECTED_EXTENSION_OBJECT",
                 path + "/extensions: KHR_mesh_quantization has no properties, ignored");
        }
        if (accessor.contains("byteOffset") && !accessor.contains("bufferView")) {
            warn(document.warnings, "UNSATISFIED_DEPENDENCY",
                 path + ": an offset and no buffer view, it is all zeros");
        }
        if (const json* sparse = Copier::object(in, path, "sparse")) {
            const std::string sparse_path = path + "/sparse";
            json& kept = accessor["sparse"];
            Copier::whole(*sparse, kept, sparse_path, "count", largest_index, true);
            const json* indices = Copier::object(*sparse, sparse_path, "indices", true);
            copy.reference(*indices, kept["indices"], sparse_path + "/indices", "bufferView", "bufferViews",
                           true);
            Copier::whole(*indices, kept["indices"], sparse_path + "/indices", "byteOffset", largest_index);
            Copier::whole(*indices, kept["indices"], sparse_path + "/indices", "componentType", largest_index,
                          true);
            component_type(kept["indices"], sparse_path + "/indices");
            const json* values = Copier::object(*sparse, sparse_path, "values", true);
            copy.reference(*values, kept["values"], sparse_path + "/values", "bufferView", "bufferViews",
                           true);
            Copier::whole(*values, kept["values"], sparse_path + "/values", "byteOffset", largest_index);
        }
        out.push_back(std::move(accessor));
    });
    return out;
}

std::optional<CompressedView> copy_compression(const Copier& copy, const json& view,
                                               const std::string& view_path) {
    const json* in = Copier::extension(view, view_path, "EXT_meshopt_compression");
    if (!in) return std::nullopt;
    const std::string path = view_path + "/extensions/EXT_meshopt_compression";
    json kept = json::object();
    copy.reference(*in, kept, path, "buffer", "buffers", true);
    Copier::whole(*in, kept, path, "byteOffset", largest_size);
    Copier::whole(*in, kept, path, "byteLength", largest_size, true);
    Copier::whole(*in, kept, path, "byteStride", 256, true);
    Copier::whole(*in, kept, path, "count", largest_index, true);
    Copier::text(*in, kept, path, "mode", true);
    Copier::one_of(kept, path, "mode", {"ATTRIBUTES", "TRIANGLES", "INDICES"});
    Copier::text(*in, kept, path, "filter");
    CompressedView out;
    out.buffer = kept["buffer"].get<int>();
    out.offset = kept.value("byteOffset", uint64_t{0});
    out.bytes = kept["byteLength"].get<uint64_t>();
    out.stride = kept["byteStride"].get<uint64_t>();
    out.count = kept["count"].get<uint64_t>();
    const std::string mode = kept["mode"].get<std::string>();
    out.mode = mode == "ATTRIBUTES"  ? MeshoptMode::attributes
               : mode == "TRIANGLES" ? MeshoptMode::triangles
                                     : MeshoptMode::indices;
    if (kept.contains("filter")) {
        Copier::one_of(kept, path, "filter", {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"});
        const std::string filter = kept["filter"].get<std::string>();
        out.filter = filter == "OCTAHEDRAL"    ? MeshoptFilter::octahedral
                     : filter == "QUATERNION"  ? MeshoptFilter::quaternion
                     : filter == "EXPONENTIAL" ? MeshoptFilter::exponential
                                               : MeshoptFilter::none;
    }
    return out;
}

json copy_buffer_views(const Copier& copy, Document& document) {
    json out = json::array();
    Copier::each(copy.root, "", "bufferViews", false, [&](const json& in, const std::string& path) {
        json view = json::object();
        copy.reference(in, view, path, "buffer", "buffers", true);
        Copier::whole(in, view, path, "byteOffset", largest_size);
        Copier::whole(in, view, path, "byteLength", largest_size, true);
        Copier::whole(in, view, path, "byteStride", largest_size);
        const uint64_t stride = view.value("byteStride", uint64_t{0});
        if (stride > 252 || stride % 4 != 0) {
            fail("VALUE_NOT_IN_RANGE", path + "/byteStride",
                 "the stride " + std::to_string(stride) + " is not a multiple of 4 up to 252", export_again);
        }
        document.compressed.push_back(copy_compression(copy, in, path));
        out.push_back(std::move(view));
    });
    return out;
}

void copy_buffers(const Copier& copy, Document& document) {
    Copier::each(copy.root, "", "buffers", false, [&](const json& in, const std::string& path) {
        json kept = json::object();
        Copier::whole(in, kept, path, "byteLength", largest_size, true);
        if (kept["byteLength"] == 0) {
            fail("VALUE_NOT_IN_RANGE", path + "/byteLength", "a buffer is empty", export_again);
        }
        BufferSource source;
        source.bytes = kept["byteLength"].get<uint64_t>();
        if (const json* uri = Copier::find(in, path, "uri", false)) {
            if (!uri->is_string()) Copier::mismatch(path + "/uri", "a string");
            source.uri = uri->get<std::string>();
        }
        document.buffers.push_back(std::move(source));
    });
}

// Indices that tinygltf is not shown.
struct HeldIndices {
    size_t mesh, primitive;
    int accessor;
};

// Of the format, or an application's own.
bool is_attribute(const std::string& name) {
    if (name.starts_with("_")) return true;
    for (const char* known : {"POSITION", "NORMAL", "TANGENT"}) {
        if (name == known) return true;
    }
    for (const char* known : {"TEXCOORD_", "COLOR_", "JOINTS_", "WEIGHTS_"}) {
        if (name.starts_with(known)) return true;
    }
    return false;
}

// Attributes that glTF does not know, and targets that move what is not there.
void warn_of_attributes(const json& primitive, const std::string& path, Document& document) {
    const json& base = *primitive.find("attributes");
    const auto tell = [&](const char* code, const std::string& where, const std::string& name,
                          const char* what) {
        warn(document.warnings, code, where + "/" + printable(name) + ": " + what);
    };
    for (const auto& [name, value] : base.items()) {
        if (!is_attribute(name))
            tell("INVALID_ATTRIBUTE", path + "/attributes", name, "no attribute of glTF, ignored");
    }
    const auto targets = primitive.find("targets");
    for (size_t i = 0; targets != primitive.end() && i < targets->size(); ++i) {
        const std::string target_path = path + "/targets/" + std::to_string(i);
        for (const auto& [name, value] : (*targets)[i].items()) {
            if (!base.contains(name))
                tell("TARGET_WITHOUT_BASE", target_path, name, "the primitive has none to move");
        }
    }
}

json copy_meshes(const Copier& copy, const json& accessors, Document& document,
                 std::vector<HeldIndices>& held) {
    json out = json::array();
    Copier::each(copy.root, "", "meshes", false, [&](const json& in, const std::string& path) {
        json mesh = json::object();
        Copier::text(in, mesh, path, "name");
        Copier::numbers(in, mesh, path, "weights", 0);
        json primitives = json::array();
        Copier::each(in, path, "primitives", true, [&](const json& given, const std::string& primitive_path) {
            json primitive = json::object();
            const auto attributes = [&](const json& from, const std::string& attributes_path) {
                json kept = json::object();
                if (!from.is_object()) Copier::mismatch(attributes_path, "an object");
                for (const auto& [name, value] : from.items()) {
                    // Texture coordinates and tangents are not read, so they can't be wrong either.
                    const bool wanted = name == "POSITION" || name == "NORMAL" || name == "COLOR_0" ||
                                        name.starts_with("JOINTS_") || name.starts_with("WEIGHTS_");
                    if (wanted) {
                        kept[name] =
                            copy.reference(value, attributes_path + "/" + printable(name), "accessors");
                    }
                }
                return kept;
            };
            primitive["attributes"] = attributes(*Copier::find(given, primitive_path, "attributes", true),
                                                 primitive_path + "/attributes");
            copy.reference(given, primitive, primitive_path, "indices", "accessors");
            if (primitive.contains("indices")) {
                const int indices = primitive["indices"].get<int>();
                if (!accessors[static_cast<size_t>(indices)].contains("bufferView")) {
                    // Legal (zeros, or sparse only), but tinygltf refuses it; put back when it is done.
                    held.push_back({out.size(), primitives.size(), indices});
                    primitive.erase("indices");
                }
            }
            copy.reference(given, primitive, primitive_path, "material", "materials");
            Copier::whole(given, primitive, primitive_path, "mode", 6);
            if (const json* targets = Copier::find(given, primitive_path, "targets", false)) {
                if (!targets->is_array()) Copier::mismatch(primitive_path + "/targets", "an array");
                json kept = json::array();
                for (size_t i = 0; i < targets->size(); ++i) {
                    kept.push_back(
                        attributes((*targets)[i], primitive_path + "/targets/" + std::to_string(i)));
                }
                primitive["targets"] = std::move(kept);
            }
            warn_of_attributes(given, primitive_path, document);
            if (Copier::extension(given, primitive_path, "KHR_draco_mesh_compression")) {
                warn(document.warnings, "DRACO_IGNORED",
                     primitive_path + ": Draco data is not read, its plain copy is used");
            }
            primitives.push_back(std::move(primitive));
        });
        mesh["primitives"] = std::move(primitives);
        out.push_back(std::move(mesh));
    });
    return out;
}

json copy_nodes(const Copier& copy) {
    json out = json::array();
    Copier::each(copy.root, "", "nodes", false, [&](const json& in, const std::string& path) {
        json node = json::object();
        Copier::text(in, node, path, "name");
        copy.references(in, node, path, "children", "nodes");
        copy.reference(in, node, path, "mesh", "meshes");
        copy.reference(in, node, path, "skin", "skins");
        Copier::numbers(in, node, path, "weights", 0);
        Copier::numbers(in, node, path, "matrix", 16);
        Copier::numbers(in, node, path, "translation", 3);
        Copier::numbers(in, node, path, "rotation", 4);
        Copier::numbers(in, node, path, "scale", 3);
        out.push_back(std::move(node));
    });
    return out;
}

json copy_skins(const Copier& copy, const LoadLimits& limits) {
    json out = json::array();
    Copier::each(copy.root, "", "skins", false, [&](const json& in, const std::string& path) {
        json skin = json::object();
        copy.reference(in, skin, path, "inverseBindMatrices", "accessors");
        copy.reference(in, skin, path, "skeleton", "nodes");
        copy.references(in, skin, path, "joints", "nodes", true);
        if (skin["joints"].empty())
            fail("EMPTY_ENTITY", path + "/joints", "a skin has no joints", export_again);
        if (skin["joints"].size() > limits.joints) {
            fail("LIMIT_JOINTS", path + "/joints",
                 "a skin has more than " + std::to_string(limits.joints) + " joints",
                 "raise the limit if you trust it");
        }
        out.push_back(std::move(skin));
    });
    return out;
}

json copy_animations(const Copier& copy, Document& document) {
    json out = json::array();
    Copier::each(copy.root, "", "animations", false, [&](const json& in, const std::string& path) {
        json animation = json::object();
        Copier::text(in, animation, path, "name");
        json samplers = json::array();
        Copier::each(in, path, "samplers", true, [&](const json& given, const std::string& sampler_path) {
            json sampler = json::object();
            copy.reference(given, sampler, sampler_path, "input", "accessors", true);
            copy.reference(given, sampler, sampler_path, "output", "accessors", true);
            Copier::text(given, sampler, sampler_path, "interpolation");
            if (sampler.contains("interpolation")) {
                Copier::one_of(sampler, sampler_path, "interpolation", {"LINEAR", "STEP", "CUBICSPLINE"});
            }
            samplers.push_back(std::move(sampler));
        });
        json channels = json::array();
        std::vector<int> pointers;
        Copier::each(in, path, "channels", true, [&](const json& given, const std::string& channel_path) {
            json channel = json::object();
            const uint64_t sampler = Copier::whole(*Copier::find(given, channel_path, "sampler", true),
                                                   channel_path + "/sampler", largest_index);
            if (sampler >= samplers.size()) {
                fail("UNRESOLVED_REFERENCE", channel_path + "/sampler",
                     "number " + std::to_string(sampler) + " of " + std::to_string(samplers.size()) +
                         " samplers",
                     export_again);
            }
            channel["sampler"] = sampler;
            const json* target = Copier::object(given, channel_path, "target", true);
            const std::string target_path = channel_path + "/target";
            json& kept = channel["target"];
            Copier::text(*target, kept, target_path, "path", true);
            copy.reference(*target, kept, target_path, "node", "nodes");
            if (kept["path"] == "pointer") {
                pointers.push_back(samplers[sampler]["input"].get<int>());
                return;
            }
            if (!kept.contains("node")) return; // an extension's target: not ours to move
            Copier::one_of(kept, target_path, "path", {"translation", "rotation", "scale", "weights"});
            channels.push_back(std::move(channel));
        });
        animation["samplers"] = std::move(samplers);
        animation["channels"] = std::move(channels);
        document.pointer_inputs.push_back(std::move(pointers));
        out.push_back(std::move(animation));
    });
    return out;
}

json copy_scenes(const Copier& copy) {
    json out = json::array();
    Copier::each(copy.root, "", "scenes", false, [&](const json& in, const std::string& path) {
        json scene = json::object();
        copy.references(in, scene, path, "nodes", "nodes");
        out.push_back(std::move(scene));
    });
    return out;
}

// Textures are not read; a reference that leads nowhere says that the file was damaged.
void warn_of_texture(const Copier& copy, const json& in, const std::string& in_path, const char* name,
                     Document& document) {
    const auto it = in.find(name);
    if (it == in.end()) return;
    const std::string path = Copier::below(in_path, name);
    const auto tell = [&](const char* code, const std::string& what) {
        warn(document.warnings, code, what + ", textures are not read");
    };
    if (!it->is_object()) return tell("TYPE_MISMATCH", path + ": not an object");
    const auto index = it->find("index");
    const bool resolved =
        index != it->end() && index->is_number_unsigned() && index->get<uint64_t>() < copy.size("textures");
    if (!resolved) tell("INVALID_INDEX", path + "/index: not the number of a texture");
    for (const char* factor : {"scale", "strength"}) {
        const auto given = it->find(factor);
        if (given != it->end() && !given->is_number())
            tell("TYPE_MISMATCH", Copier::below(path, factor) + ": not a number");
    }
}

json copy_materials(const Copier& copy, Document& document) {
    json out = json::array();
    Copier::each(copy.root, "", "materials", false, [&](const json& in, const std::string& path) {
        json material = json::object();
        if (const json* pbr = Copier::object(in, path, "pbrMetallicRoughness")) {
            const std::string pbr_path = path + "/pbrMetallicRoughness";
            json kept = json::object();
            Copier::numbers(*pbr, kept, pbr_path, "baseColorFactor", 4);
            Copier::number(*pbr, kept, pbr_path, "metallicFactor");
            Copier::number(*pbr, kept, pbr_path, "roughnessFactor");
            for (const char* texture : {"baseColorTexture", "metallicRoughnessTexture"})
                warn_of_texture(copy, *pbr, pbr_path, texture, document);
            if (!kept.empty()) material["pbrMetallicRoughness"] = std::move(kept);
        }
        Copier::flag(in, material, path, "doubleSided");
        for (const char* texture : {"normalTexture", "occlusionTexture", "emissiveTexture"})
            warn_of_texture(copy, in, path, texture, document);
        out.push_back(std::move(material));
    });
    return out;
}

// Extensions that change nothing of the geometry, or that we read.
bool supported(const std::string& extension) {
    static constexpr std::array names = {
        "KHR_mesh_quantization", "EXT_meshopt_compression", "KHR_texture_transform", "KHR_lights_punctual",
        "KHR_texture_basisu",    "EXT_texture_webp",        "EXT_texture_avif",      "MSFT_texture_dds",
        "KHR_xmp_json_ld",       "EXT_lights_image_based",  "KHR_animation_pointer",
    };
    return extension.starts_with("KHR_materials_") ||
           std::any_of(names.begin(), names.end(), [&](const char* name) { return extension == name; });
}

std::vector<std::string> names(const json& root, const char* array) {
    std::vector<std::string> out;
    if (const json* list = Copier::find(root, "", array, false)) {
        if (!list->is_array()) Copier::mismatch(std::string("/") + array, "an array");
        for (const json& name : *list) {
            if (!name.is_string()) Copier::mismatch(std::string("/") + array, "an array of strings");
            out.push_back(name.get<std::string>());
        }
    }
    return out;
}

json copy_asset(const Copier& copy, std::vector<std::string>& warnings) {
    const json* in = Copier::object(copy.root, "", "asset", true);
    json asset = json::object();
    Copier::text(*in, asset, "/asset", "version", true);
    Copier::text(*in, asset, "/asset", "minVersion");
    Copier::text(*in, asset, "/asset", "generator");
    const auto two = [](const std::string& version) {
        return version.size() > 2 && version.starts_with("2.") &&
               std::all_of(version.begin() + 2, version.end(), [](char c) { return c >= '0' && c <= '9'; });
    };
    const std::string version = asset["version"].get<std::string>();
    if (!two(version)) {
        fail("UNSUPPORTED_VERSION", "/asset/version", "it is glTF version '" + printable(version, 12) + "'",
             "convert it to glTF 2.0");
    }
    // A later minor version must stay readable; what it adds is told apart by the warning.
    const std::string least = asset.value("minVersion", std::string("2.0"));
    if (!two(least) || version.size() < least.size() || (version.size() == least.size() && version < least)) {
        fail("UNSUPPORTED_VERSION", "/asset/minVersion",
             "version '" + printable(version, 12) + "' asks for a reader of '" + printable(least, 12) + "'",
             export_again);
    }
    if (least != "2.0") {
        warn(warnings, "LATER_VERSION",
             "made for readers of glTF " + printable(least, 12) + ": parts may be missing");
    }
    return asset;
}

// Readers that don't know it would take the integers for positions.
void warn_of_quantization(const std::vector<std::string>& used, const std::vector<std::string>& required,
                          Document& document) {
    const auto names_it = [](const std::vector<std::string>& all) {
        return std::find(all.begin(), all.end(), "KHR_mesh_quantization") != all.end();
    };
    if (names_it(used) && !names_it(required)) {
        warn(document.warnings, "NON_REQUIRED_EXTENSION",
             "/extensionsRequired: KHR_mesh_quantization is used and not required");
    }
}

} // namespace

Document read_document(std::string_view text, const LoadLimits& limits) {
    Scan scan(limits);
    json::sax_parse(text.begin(), text.end(), &scan);
    if (text.size() - scan.uri_bytes > limits.json_bytes) {
        fail("LIMIT_JSON", "", "the JSON has more than " + std::to_string(limits.json_bytes >> 20) + " MiB",
             "raise the limit if you trust it");
    }
    const json root = json::parse(text.begin(), text.end(), nullptr, false);
    if (!root.is_object()) fail("TYPE_MISMATCH", "", "the JSON is not an object", "name a glTF 2.0 file");
    for (const auto& [name, value] : root.items()) {
        if (value.is_array() && value.size() > limits.elements) {
            fail("LIMIT_ELEMENTS", "/" + printable(name),
                 "more than " + std::to_string(limits.elements) + " elements",
                 "raise the limit if you trust it");
        }
    }

    const Copier copy{root};
    Document document;
    json reduced = json::object();
    reduced["asset"] = copy_asset(copy, document.warnings);
    std::vector<std::string> used = names(root, "extensionsUsed");
    for (const std::string& name : names(root, "extensionsRequired")) {
        if (!supported(name)) {
            fail("UNSUPPORTED_EXTENSION", "/extensionsRequired", "it requires " + printable(name),
                 name == "KHR_draco_mesh_compression"
                     ? "remove the Draco compression, for example with gltf-transform"
                     : "export it without that extension");
        }
    }
    for (const std::string& name : used) {
        if (!supported(name))
            warn(document.warnings, "EXTENSION_IGNORED", "extension " + printable(name) + " is ignored");
    }
    warn_of_quantization(used, names(root, "extensionsRequired"), document);
    reduced["accessors"] = copy_accessors(copy, document);
    reduced["bufferViews"] = copy_buffer_views(copy, document);
    copy_buffers(copy, document);
    reduced["materials"] = copy_materials(copy, document);
    std::vector<HeldIndices> held;
    reduced["meshes"] = copy_meshes(copy, reduced["accessors"], document, held);
    reduced["nodes"] = copy_nodes(copy);
    reduced["skins"] = copy_skins(copy, limits);
    reduced["animations"] = copy_animations(copy, document);
    reduced["scenes"] = copy_scenes(copy);
    copy.reference(root, reduced, "", "scene", "scenes");

    const std::string plain = reduced.dump();
    tinygltf::TinyGLTF reader;
    std::string error, warning;
    const bool read = reader.LoadASCIIFromString(&document.gltf, &error, &warning, plain.data(),
                                                 static_cast<unsigned int>(plain.size()), "");
    const tinygltf::Model& gltf = document.gltf;
    // tinygltf leaves out what it can't read instead of failing; then indices would point elsewhere.
    const bool complete = read && gltf.accessors.size() == reduced["accessors"].size() &&
                          gltf.bufferViews.size() == reduced["bufferViews"].size() &&
                          gltf.meshes.size() == reduced["meshes"].size() &&
                          gltf.nodes.size() == reduced["nodes"].size() &&
                          gltf.skins.size() == reduced["skins"].size() &&
                          gltf.animations.size() == reduced["animations"].size() &&
                          gltf.scenes.size() == reduced["scenes"].size() &&
                          gltf.materials.size() == reduced["materials"].size();
    if (!complete) {
        fail("UNREADABLE", "", "tinygltf can't read it: " + printable(error.substr(0, error.find('\n')), 60),
             export_again);
    }
    for (const HeldIndices& h : held) {
        document.gltf.meshes[h.mesh].primitives.at(h.primitive).indices = h.accessor;
    }
    document.gltf.extensionsUsed = std::move(used);
    return document;
}

} // namespace nusselt::load
