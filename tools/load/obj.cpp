// Wavefront OBJ: v, vn, f, usemtl, and Kd of the materials. The rest says nothing about shape.
#include "tools/load/error.h"
#include "tools/load/formats.h"
#include "tools/load/rig.h"

#include <glm/geometric.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string_view>
#include <tuple>

namespace nusselt::load {
namespace {

constexpr std::string_view blanks = " \t\r";

// Cuts the first word off the front of `line`.
std::string_view word(std::string_view& line) {
    const size_t begin = line.find_first_not_of(blanks);
    if (begin == std::string_view::npos) {
        line = {};
        return {};
    }
    const size_t end = std::min(line.find_first_of(blanks, begin), line.size());
    const std::string_view out = line.substr(begin, end - begin);
    line.remove_prefix(end);
    return out;
}

std::string_view trimmed(std::string_view line) {
    const size_t begin = line.find_first_not_of(blanks);
    if (begin == std::string_view::npos) return {};
    return line.substr(begin, line.find_last_not_of(blanks) - begin + 1);
}

template<class Number>
std::optional<Number> number(std::string_view text) {
    if (text.starts_with('+')) text.remove_prefix(1);
    Number value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (end != text.data() + text.size() || error != std::errc()) return std::nullopt;
    return value;
}

// By way of double: what is too small for a float is 0, what is too large is infinite.
std::optional<float> real(std::string_view text) {
    const std::optional<double> value = number<double>(text);
    if (!value) return std::nullopt;
    if (std::abs(*value) > 3.4e38) return std::numeric_limits<float>::infinity();
    return static_cast<float>(*value);
}

// Calls line(text, number) for each line, ends of all kinds; a backslash at the end joins two.
template<class Line>
void each_line(std::string text, Line line) {
    for (size_t i = 0; i + 1 < text.size(); ++i) {
        if (text[i] != '\\') continue;
        if (text[i + 1] == '\n') {
            text[i] = text[i + 1] = ' ';
        } else if (text[i + 1] == '\r' && i + 2 < text.size() && text[i + 2] == '\n') {
            text[i] = text[i + 1] = text[i + 2] = ' ';
        }
    }
    size_t count = 0;
    for (size_t begin = 0; begin < text.size();) {
        const size_t end = std::min(text.find('\n', begin), text.size());
        std::string_view view(text.data() + begin, end - begin);
        view = view.substr(0, view.find('#'));
        line(view, ++count);
        begin = end + 1;
    }
}

using Materials = std::map<std::string, glm::vec3, std::less<>>;

void read_materials(const std::string& path, const std::string& name, Materials& materials, Model& model) {
    constexpr uint64_t most = 16u << 20;
    try {
        const Bytes file = read_beneath(path, name, most, "");
        std::string current;
        each_line(std::string(file.begin(), file.end()), [&](std::string_view line, size_t) {
            const std::string_view first = word(line);
            if (first == "newmtl") {
                current = trimmed(line);
                materials.emplace(current, glm::vec3(1.0f));
            } else if (first == "Kd") {
                glm::vec3 colour(1.0f);
                for (int i = 0; i < 3; ++i) {
                    const float value = real(word(line)).value_or(1.0f);
                    colour[i] = value >= 0.0f ? std::min(value, 1.0f) : 0.0f;
                }
                materials[current] = colour;
            }
        });
    } catch (const LoadError& error) {
        warn(model.warnings, "MATERIALS_IGNORED", "materials are white: " + error.what);
    }
}

std::string at_line(size_t line) {
    return "line " + std::to_string(line);
}

} // namespace

Model read_obj(const std::string& path, Bytes file, const LoadLimits& limits) {
    Model model;
    model.format = "OBJ";
    Source source;
    std::vector<glm::vec3> normals;
    std::vector<glm::vec3> colours; // of the vertices so far, white where the file gives none
    Materials materials;
    glm::vec3 material(1.0f);
    struct Use {
        int64_t normal = -1;
        glm::vec3 albedo{1.0f};
        bool used = false;
    };
    std::vector<Use> uses;
    std::map<std::tuple<int64_t, int64_t, float, float, float>, uint32_t> copies;
    struct Corner {
        int64_t vertex, normal;
    };
    std::vector<Corner> corners;
    std::vector<uint32_t> polygon;
    struct Duplicate {
        uint32_t of;
        int64_t normal;
        glm::vec3 albedo;
    };
    std::vector<Duplicate> duplicates; // numbered from the last `v`, which is only known at the end
    size_t short_faces = 0;

    std::string text(file.begin(), file.end());
    file = Bytes();

    const auto vector = [&](std::string_view& line, size_t number_of_line) {
        glm::vec3 v;
        for (int i = 0; i < 3; ++i) {
            const std::string_view part = word(line);
            const auto value = real(part);
            if (!value) {
                fail("OBJ_NUMBER", at_line(number_of_line),
                     part.empty() ? "a coordinate is missing"
                                  : "'" + printable(part) + "' is not a number in range",
                     export_again);
            }
            v[i] = *value;
        }
        return v;
    };
    const auto resolve = [&](std::string_view part, size_t count, const char* what, size_t line) {
        const auto given = number<int64_t>(part);
        const auto size = static_cast<int64_t>(count);
        const int64_t index = !given                          ? -1
                              : *given > 0                    ? *given - 1
                              : *given < 0 && *given >= -size ? size + *given
                                                              : -1;
        if (index < 0 || index >= size) {
            fail("OBJ_INDEX", at_line(line),
                 "'" + printable(part) + "' is not one of the " + std::to_string(count) + " " + what +
                     " so far",
                 export_again);
        }
        return index;
    };

    // Indices from here on stand for duplicates.
    constexpr uint32_t duplicate_base = 0x80000000u;
    each_line(std::move(text), [&](std::string_view line, size_t line_number) {
        const std::string_view first = word(line);
        if (first == "v") {
            if (source.positions.size() >= limits.vertices) {
                fail("LIMIT_VERTICES", at_line(line_number),
                     "more than " + std::to_string(limits.vertices) + " vertices",
                     "raise the limit if you trust it");
            }
            const glm::vec3 p = vector(line, line_number);
            if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
                fail("POSITION_NOT_FINITE", at_line(line_number),
                     "vertex " + std::to_string(source.positions.size()) + " is not a finite point",
                     export_again);
            }
            glm::vec3 colour(1.0f);
            const auto r = real(word(line)), g = real(word(line)), b = real(word(line));
            if (r && g && b) {
                const auto clamped = [](float c) { return c >= 0.0f ? std::min(c, 1.0f) : 0.0f; };
                colour = {clamped(*r), clamped(*g), clamped(*b)};
            }
            source.positions.push_back(p);
            colours.push_back(colour);
            uses.emplace_back();
        } else if (first == "vn") {
            normals.push_back(vector(line, line_number));
        } else if (first == "mtllib") {
            read_materials(path, std::string(trimmed(line)), materials, model);
        } else if (first == "usemtl") {
            const auto it = materials.find(trimmed(line));
            material = it == materials.end() ? glm::vec3(1.0f) : it->second;
        } else if (first == "f") {
            corners.clear();
            for (std::string_view part = word(line); !part.empty(); part = word(line)) {
                const size_t slash = part.find('/');
                Corner corner{
                    resolve(part.substr(0, slash), source.positions.size(), "vertices", line_number), -1};
                const size_t second = slash == std::string_view::npos ? slash : part.find('/', slash + 1);
                if (second != std::string_view::npos && second + 1 < part.size()) {
                    corner.normal = resolve(part.substr(second + 1), normals.size(), "normals", line_number);
                }
                corners.push_back(corner);
            }
            if (corners.size() < 3) {
                ++short_faces;
                return;
            }
            if (source.indices.size() / 3 + corners.size() - 2 > limits.triangles) {
                fail("LIMIT_TRIANGLES", at_line(line_number),
                     "more than " + std::to_string(limits.triangles) + " triangles",
                     "raise the limit if you trust it");
            }
            polygon.clear();
            for (const Corner& corner : corners) {
                const auto v = static_cast<size_t>(corner.vertex);
                const glm::vec3 albedo = material * colours[v];
                Use& use = uses[v];
                if (!use.used) use = {corner.normal, albedo, true};
                if (use.normal == corner.normal && use.albedo == albedo) {
                    polygon.push_back(static_cast<uint32_t>(v));
                    continue;
                }
                // One position with another normal or colour is another vertex.
                const auto [copy, added] =
                    copies.try_emplace({corner.vertex, corner.normal, albedo.x, albedo.y, albedo.z},
                                       duplicate_base + static_cast<uint32_t>(duplicates.size()));
                if (added) duplicates.push_back({static_cast<uint32_t>(v), corner.normal, albedo});
                polygon.push_back(copy->second);
            }
            for (size_t i = 2; i < polygon.size(); ++i) {
                source.indices.insert(source.indices.end(), {polygon[0], polygon[i - 1], polygon[i]});
            }
        }
    });
    if (short_faces > 0) {
        warn(model.warnings, "SHORT_FACE",
             std::to_string(short_faces) + " faces with fewer than 3 corners are left out");
    }

    const auto given = static_cast<uint32_t>(source.positions.size());
    for (uint32_t& index : source.indices) {
        if (index >= duplicate_base) index = index - duplicate_base + given;
    }
    const auto add = [&](int64_t normal, const glm::vec3& albedo) {
        const glm::dvec3 n = normal < 0 ? glm::dvec3(0.0) : glm::dvec3(normals[static_cast<size_t>(normal)]);
        const double length = glm::length(n);
        const bool good = length > 1e-12 && std::isfinite(length);
        source.normals.push_back(good ? glm::vec3(n / length) : glm::vec3(0.0f, 1.0f, 0.0f));
        source.normal_missing.push_back(!good);
        source.albedo.push_back(albedo);
    };
    for (const Use& use : uses) {
        add(use.normal, use.albedo);
    }
    for (const Duplicate& copy : duplicates) {
        source.positions.push_back(source.positions[copy.of]);
        add(copy.normal, copy.albedo);
    }
    model.materials = materials.size();
    finish_static(model, std::move(source), "mesh");
    model.stored_vertices = given;
    return model;
}

} // namespace nusselt::load
