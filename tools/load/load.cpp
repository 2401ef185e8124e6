#include "tools/load/error.h"
#include "tools/load/formats.h"

#include <algorithm>
#include <exception>
#include <new>
#include <string_view>

namespace nusselt::load {
namespace {

std::string_view extension(const std::string& path, std::string& lower) {
    const size_t dot = path.rfind('.');
    if (dot == std::string::npos || path.find('/', dot) != std::string::npos) return {};
    lower = path.substr(dot + 1);
    std::transform(lower.begin(), lower.end(), lower.begin(),
                   [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
    return lower;
}

// By content first: many a file has the wrong name. OBJ has no mark of its own.
Model read_any(const std::string& path, const LoadLimits& limits) {
    // Text of data URIs is a third longer than the data.
    Bytes file = read_file(path, limits.json_bytes + limits.buffer_bytes / 3 * 4);
    if (file.empty()) fail("EMPTY_FILE", "", "it is empty", file_incomplete);
    const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    std::string lower;
    const std::string_view name = extension(path, lower);
    if (text.starts_with("glTF")) return read_gltf(path, std::move(file), limits);
    if (text.starts_with("ply\n") || text.starts_with("ply\r"))
        return read_ply(path, std::move(file), limits);
    const size_t first = text.find_first_not_of(" \t\r\n");
    const bool json = first != std::string_view::npos && (text[first] == '{' || text[first] == '[');
    if (name == "gltf" || (json && name != "obj")) return read_gltf(path, std::move(file), limits);
    if (name == "obj") return read_obj(path, std::move(file), limits);
    if (name == "glb")
        fail("GLB_MAGIC", "", "it does not begin as a GLB does", "check that the file is complete");
    if (name == "ply")
        fail("PLY_HEADER", "", "it does not begin as a PLY does", "check that the file is complete");
    fail("UNKNOWN_FORMAT", "", "it is none of glTF, GLB, OBJ, PLY", "convert it to glTF 2.0");
}

std::string file_name(const std::string& path) {
    const size_t slash = path.rfind('/');
    return slash == std::string::npos ? path : path.substr(slash + 1);
}

} // namespace

std::string clean_name(const std::string& name) {
    std::string out;
    for (size_t i = 0; i < name.size() && out.size() < 256; ++i) {
        const auto byte = static_cast<unsigned char>(name[i]);
        if (byte < 0x20 || byte == 0x7F) continue;
        // U+0080 to U+009F are control characters too.
        if (byte == 0xC2 && i + 1 < name.size() && static_cast<unsigned char>(name[i + 1]) < 0xA0) {
            ++i;
            continue;
        }
        out += name[i];
    }
    // Not half a character at the end.
    if (out.size() == 256) {
        while (!out.empty() && (static_cast<unsigned char>(out.back()) & 0xC0) == 0x80)
            out.pop_back();
        if (!out.empty() && static_cast<unsigned char>(out.back()) >= 0xC0) out.pop_back();
    }
    return out;
}

LoadResult load_model(const std::string& path, const LoadLimits& limits) {
    LoadResult result;
    try {
        result.model = read_any(path, limits);
        result.model.name = clean_name(file_name(path));
        result.ok = true;
    } catch (LoadError& error) {
        result.error = std::move(error);
    } catch (const std::bad_alloc&) {
        result.error = {"OUT_OF_MEMORY", "", "it needs more memory than there is",
                        "free some or split the model"};
    } catch (const std::exception& error) {
        // A library's own check; the checks before it should have caught this.
        result.error = {"UNREADABLE", "", "it can't be read: " + printable(error.what(), 60), export_again};
    }
    if (!result.ok) result.model = Model();
    return result;
}

} // namespace nusselt::load
