// PLY: ascii, binary little and big endian. The elements `vertex` and `face` are read, all others stepped
// over.
#include "tools/load/error.h"
#include "tools/load/formats.h"
#include "tools/load/rig.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string_view>

namespace nusselt::load {
namespace {

enum class Encoding { ascii, little, big };
enum class Type { none, i8, u8, i16, u16, i32, u32, f32, f64 };

struct Property {
    std::string name;
    Type type = Type::none;
    Type count_type = Type::none; // not none: a list
};

struct Element {
    std::string name;
    uint64_t count = 0;
    std::vector<Property> properties;
};

Type type_of(std::string_view name) {
    static constexpr std::array<std::pair<std::string_view, Type>, 16> types = {{{"char", Type::i8},
                                                                                 {"int8", Type::i8},
                                                                                 {"uchar", Type::u8},
                                                                                 {"uint8", Type::u8},
                                                                                 {"short", Type::i16},
                                                                                 {"int16", Type::i16},
                                                                                 {"ushort", Type::u16},
                                                                                 {"uint16", Type::u16},
                                                                                 {"int", Type::i32},
                                                                                 {"int32", Type::i32},
                                                                                 {"uint", Type::u32},
                                                                                 {"uint32", Type::u32},
                                                                                 {"float", Type::f32},
                                                                                 {"float32", Type::f32},
                                                                                 {"double", Type::f64},
                                                                                 {"float64", Type::f64}}};
    for (const auto& [known, type] : types) {
        if (known == name) return type;
    }
    return Type::none;
}

size_t bytes_of(Type type) {
    switch (type) {
    case Type::i8:
    case Type::u8:
        return 1;
    case Type::i16:
    case Type::u16:
        return 2;
    case Type::f64:
        return 8;
    default:
        return 4;
    }
}

struct Cursor {
    const Bytes& file;
    size_t at = 0;
    Encoding encoding = Encoding::ascii;

    static bool blank(uint8_t c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

    [[noreturn]] void cut_off() const {
        fail("PLY_TRUNCATED", "byte " + std::to_string(at), "the PLY data is cut off", file_incomplete);
    }

    std::string_view line() {
        const size_t begin = at;
        while (at < file.size() && file[at] != '\n' && file[at] != '\r')
            ++at;
        const std::string_view out(reinterpret_cast<const char*>(file.data()) + begin, at - begin);
        if (at < file.size() && file[at] == '\r') ++at;
        if (at < file.size() && file[at] == '\n') ++at;
        return out;
    }

    // Every PLY type is exact in a double.
    double value(Type type) {
        if (encoding == Encoding::ascii) {
            while (at < file.size() && blank(file[at]))
                ++at;
            const char* begin = reinterpret_cast<const char*>(file.data()) + at;
            const size_t start = at;
            while (at < file.size() && !blank(file[at]))
                ++at;
            if (at == start) cut_off();
            const char* end = begin + (at - start);
            if (*begin == '+') ++begin;
            double number = 0;
            const auto [stop, error] = std::from_chars(begin, end, number);
            if (stop != end || error != std::errc()) {
                fail("PLY_NUMBER", "byte " + std::to_string(start),
                     "'" + printable({begin, static_cast<size_t>(end - begin)}) +
                         "' is not a number in range",
                     export_again);
            }
            return number;
        }
        const size_t bytes = bytes_of(type);
        if (file.size() - at < bytes) cut_off();
        uint64_t bits = 0;
        for (size_t i = 0; i < bytes; ++i) {
            const size_t shift = encoding == Encoding::little ? i : bytes - 1 - i;
            bits |= static_cast<uint64_t>(file[at + i]) << (8 * shift);
        }
        at += bytes;
        switch (type) {
        case Type::i8:
            return static_cast<int8_t>(bits);
        case Type::i16:
            return static_cast<int16_t>(bits);
        case Type::i32:
            return static_cast<int32_t>(bits);
        case Type::f32:
            return static_cast<double>(std::bit_cast<float>(static_cast<uint32_t>(bits)));
        case Type::f64:
            return std::bit_cast<double>(bits);
        default:
            return static_cast<double>(bits);
        }
    }

    uint64_t list_length(Type type) {
        const size_t begin = at;
        const double length = value(type);
        const size_t least = encoding == Encoding::ascii ? 2 : 1; // bytes of an entry: a blank and a digit
        if (!(length >= 0) || length != std::floor(length) ||
            length > static_cast<double>((file.size() - at) / least + 1)) {
            fail("PLY_LIST", "byte " + std::to_string(begin), "a list's length is out of range",
                 file_incomplete);
        }
        return static_cast<uint64_t>(length);
    }
};

std::vector<std::string_view> split(std::string_view line) {
    std::vector<std::string_view> words;
    while (true) {
        const size_t begin = line.find_first_not_of(" \t");
        if (begin == std::string_view::npos) return words;
        const size_t end = std::min(line.find_first_of(" \t", begin), line.size());
        words.push_back(line.substr(begin, end - begin));
        line.remove_prefix(end);
    }
}

std::vector<Element> read_header(Cursor& cursor) {
    std::vector<Element> elements;
    const auto broken = [&](std::string_view line) {
        fail("PLY_HEADER", "byte " + std::to_string(cursor.at),
             "the PLY header says '" + printable(line) + "'", export_again);
    };
    cursor.line(); // "ply"
    bool format = false;
    while (true) {
        if (cursor.at >= cursor.file.size()) {
            fail("PLY_HEADER", "", "the PLY header has no end", file_incomplete);
        }
        const std::string_view line = cursor.line();
        const std::vector<std::string_view> words = split(line);
        if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
        if (words[0] == "end_header") break;
        if (words[0] == "format" && words.size() >= 2) {
            if (words[1] == "ascii") {
                cursor.encoding = Encoding::ascii;
            } else if (words[1] == "binary_little_endian") {
                cursor.encoding = Encoding::little;
            } else if (words[1] == "binary_big_endian") {
                cursor.encoding = Encoding::big;
            } else {
                broken(line);
            }
            format = true;
        } else if (words[0] == "element" && words.size() == 3) {
            Element element;
            element.name = words[1];
            const auto [end, error] =
                std::from_chars(words[2].data(), words[2].data() + words[2].size(), element.count);
            if (error != std::errc() || end != words[2].data() + words[2].size()) broken(line);
            elements.push_back(std::move(element));
        } else if (words[0] == "property" && !elements.empty() && words.size() >= 3) {
            Property property;
            property.name = words.back();
            const bool list = words[1] == "list";
            if (words.size() != (list ? 5u : 3u)) broken(line);
            property.type = type_of(words[list ? 3 : 1]);
            if (list) property.count_type = type_of(words[2]);
            if (property.type == Type::none || (list && property.count_type == Type::none)) broken(line);
            elements.back().properties.push_back(std::move(property));
        } else {
            broken(line);
        }
    }
    if (!format) fail("PLY_HEADER", "", "the PLY header names no format", export_again);
    return elements;
}

// The least number of bytes that one of these can take.
uint64_t least_bytes(const Element& element, Encoding encoding) {
    uint64_t bytes = 0;
    for (const Property& property : element.properties) {
        bytes += encoding == Encoding::ascii
                     ? 2
                     : bytes_of(property.count_type != Type::none ? property.count_type : property.type);
    }
    return bytes;
}

// Colours of PLY files are sRGB by custom; albedo is linear.
float linear(double srgb) {
    const double c = std::clamp(srgb, 0.0, 1.0);
    return static_cast<float>(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
}

void read_vertices(Cursor& cursor, const Element& element, Source& source) {
    enum Slot { x, y, z, nx, ny, nz, red, green, blue, slots };
    static constexpr const char* slot_names[slots] = {"x",  "y",   "z",     "nx",  "ny",
                                                      "nz", "red", "green", "blue"};
    std::vector<int> slot_of(element.properties.size(), -1);
    std::array<Type, slots> given{};
    for (size_t p = 0; p < element.properties.size(); ++p) {
        const Property& property = element.properties[p];
        for (int s = 0; s < slots; ++s) {
            if (property.name == slot_names[s] && property.count_type == Type::none) {
                slot_of[p] = s;
                given[static_cast<size_t>(s)] = property.type;
            }
        }
    }
    if (given[x] == Type::none || given[y] == Type::none || given[z] == Type::none) {
        fail("PLY_HEADER", "", "the PLY vertices have no x, y, z", export_again);
    }
    const bool has_normals = given[nx] != Type::none && given[ny] != Type::none && given[nz] != Type::none;
    const bool has_colours =
        given[red] != Type::none && given[green] != Type::none && given[blue] != Type::none;
    const double colour_scale = given[red] == Type::u8 ? 255.0 : given[red] == Type::u16 ? 65535.0 : 1.0;
    for (uint64_t v = 0; v < element.count; ++v) {
        std::array<double, slots> values{};
        for (size_t p = 0; p < element.properties.size(); ++p) {
            const Property& property = element.properties[p];
            if (property.count_type != Type::none) {
                for (uint64_t n = cursor.list_length(property.count_type); n > 0; --n) {
                    cursor.value(property.type);
                }
                continue;
            }
            const double value = cursor.value(property.type);
            if (slot_of[p] >= 0) values[static_cast<size_t>(slot_of[p])] = value;
        }
        // Checked before they become floats: a double beyond the range of float has none.
        for (const double value : {values[x], values[y], values[z]}) {
            if (!(std::abs(value) <= 3.4e38)) {
                fail("POSITION_NOT_FINITE", "", "vertex " + std::to_string(v) + " is not a finite point",
                     export_again);
            }
        }
        source.positions.emplace_back(values[x], values[y], values[z]);
        const glm::dvec3 n(values[nx], values[ny], values[nz]);
        const double length = glm::length(n);
        const bool good = has_normals && length > 1e-12 && std::isfinite(length);
        source.normals.push_back(good ? glm::vec3(n / length) : glm::vec3(0.0f, 1.0f, 0.0f));
        source.normal_missing.push_back(!good);
        glm::vec3 albedo(1.0f);
        if (has_colours) {
            for (size_t i = 0; i < 3; ++i) {
                const double c = values[red + i] / colour_scale;
                albedo[static_cast<int>(i)] = std::isfinite(c) ? linear(c) : 1.0f;
            }
        }
        source.albedo.push_back(albedo);
    }
}

// Every other triangle of a strip runs the other way; repeated corners join strips and are not drawn.
void add_strip(const std::vector<uint64_t>& strip, std::vector<uint64_t>& corners) {
    for (size_t k = 2; k < strip.size(); ++k) {
        const uint64_t a = strip[k - 2], b = strip[k - 1], c = strip[k];
        if (a == b || b == c || c == a) continue;
        if (k % 2 == 0) {
            corners.insert(corners.end(), {a, b, c});
        } else {
            corners.insert(corners.end(), {b, a, c});
        }
    }
}

} // namespace

Model read_ply(const std::string& path, Bytes file, const LoadLimits& limits) {
    (void)path;
    Model model;
    model.format = "PLY";
    Cursor cursor{file};
    const std::vector<Element> elements = read_header(cursor);
    Source source;
    std::vector<uint64_t> polygon;
    std::vector<uint64_t> corners; // three a triangle; checked when all vertices are known
    size_t short_faces = 0;
    for (const Element& element : elements) {
        const uint64_t least = least_bytes(element, cursor.encoding);
        const uint64_t left = file.size() - cursor.at;
        // One byte of grace: the last number of an ascii file needs no blank behind it.
        if (least == 0 ? element.count > 0 : element.count > (left + 1) / least) {
            fail("PLY_TRUNCATED", "",
                 std::to_string(element.count) + " of element '" + printable(element.name) +
                     "' don't fit into " + std::to_string(left) + " bytes",
                 file_incomplete);
        }
        const bool vertices = element.name == "vertex";
        if (vertices && element.count > limits.vertices) {
            fail("LIMIT_VERTICES", "", "more than " + std::to_string(limits.vertices) + " vertices",
                 "raise the limit if you trust it");
        }
        if (vertices && source.positions.empty()) {
            read_vertices(cursor, element, source);
            continue;
        }
        for (uint64_t i = 0; i < element.count; ++i) {
            for (const Property& property : element.properties) {
                if (property.count_type == Type::none) {
                    cursor.value(property.type);
                    continue;
                }
                const bool indices = property.name == "vertex_indices" || property.name == "vertex_index";
                const bool strip = indices && element.name == "tristrips";
                const bool face = indices && element.name == "face";
                polygon.clear();
                for (uint64_t n = cursor.list_length(property.count_type); n > 0; --n) {
                    const double index = cursor.value(property.type);
                    if (!face && !strip) continue;
                    if (strip && index < 0) { // the next strip begins
                        add_strip(polygon, corners);
                        polygon.clear();
                        continue;
                    }
                    if (!(index >= 0 && index < 4294967296.0)) {
                        fail("PLY_INDEX", "",
                             element.name + " " + std::to_string(i) + " has an index out of range",
                             export_again);
                    }
                    polygon.push_back(static_cast<uint64_t>(index));
                }
                if (strip) add_strip(polygon, corners);
                if (face) {
                    short_faces += polygon.size() < 3;
                    for (size_t k = 2; k < polygon.size(); ++k) {
                        corners.insert(corners.end(), {polygon[0], polygon[k - 1], polygon[k]});
                    }
                }
                if (corners.size() / 3 > limits.triangles) {
                    fail("LIMIT_TRIANGLES", "",
                         "more than " + std::to_string(limits.triangles) + " triangles",
                         "raise the limit if you trust it");
                }
            }
        }
    }
    if (short_faces > 0) {
        warn(model.warnings, "SHORT_FACE",
             std::to_string(short_faces) + " faces with fewer than 3 corners are left out");
    }
    source.indices.reserve(corners.size());
    for (size_t i = 0; i < corners.size(); ++i) {
        if (corners[i] >= source.positions.size()) {
            fail("PLY_INDEX", "",
                 "triangle " + std::to_string(i / 3) + " uses vertex " + std::to_string(corners[i]) + " of " +
                     std::to_string(source.positions.size()),
                 export_again);
        }
        source.indices.push_back(static_cast<uint32_t>(corners[i]));
    }
    finish_static(model, std::move(source), "mesh");
    return model;
}

} // namespace nusselt::load
