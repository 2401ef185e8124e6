// The real models and the broken files of the shared data.
#include "gltf_builder.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>

namespace nusselt::load::test {
namespace {

const std::filesystem::path data_folder = std::filesystem::path(NUSSELT_SHARED_DIR) / "data";

std::vector<std::string> cells(const std::string& line, char separator) {
    std::vector<std::string> out;
    std::stringstream stream(line);
    for (std::string cell; std::getline(stream, cell, separator);) {
        const size_t begin = cell.find_first_not_of(' ');
        out.push_back(
            begin == std::string::npos ? "" : cell.substr(begin, cell.find_last_not_of(' ') - begin + 1));
    }
    return out;
}

// "2,978 (1,452)": 2978 and 1452.
std::vector<size_t> counts(const std::string& cell) {
    std::vector<size_t> out;
    static const std::regex number("[0-9][0-9,]*");
    for (auto it = std::sregex_iterator(cell.begin(), cell.end(), number); it != std::sregex_iterator();
         ++it) {
        std::string digits = it->str();
        std::erase(digits, ',');
        out.push_back(std::stoull(digits));
    }
    return out;
}

void expect_finite(const Model& model, const std::string& file) {
    scenes::Pose pose;
    for (int clip = -1; clip < static_cast<int>(model.clips.size()); ++clip) {
        const scenes::Scene scene = make_scene(model, clip);
        ASSERT_EQ(scene.meshes.size(), model.meshes.size());
        for (const double part : {0.0, 0.31, 0.77, 1.0}) {
            scene.pose(part * scene.duration, pose);
            size_t bad = 0;
            for (size_t m = 0; m < scene.meshes.size(); ++m) {
                ASSERT_EQ(pose.positions[m].size(), scene.meshes[m].rest_positions.size());
                ASSERT_EQ(pose.normals[m].size(), scene.meshes[m].rest_positions.size());
                ASSERT_EQ(scene.meshes[m].rest_normals.size(), scene.meshes[m].rest_positions.size());
                ASSERT_EQ(scene.meshes[m].albedo.size(), scene.meshes[m].rest_positions.size());
                for (const uint32_t index : scene.meshes[m].indices) {
                    bad += index >= scene.meshes[m].rest_positions.size();
                }
                for (const glm::vec3& p : pose.positions[m]) {
                    bad += !(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
                }
                for (const glm::vec3& n : pose.normals[m]) {
                    bad += !(std::abs(n.x * n.x + n.y * n.y + n.z * n.z - 1) < 1e-4f);
                }
            }
            EXPECT_EQ(bad, 0u) << file << " clip " << clip << " at " << part;
        }
    }
}

void expect_clean(const std::string& text) {
    for (const char c : text) {
        EXPECT_TRUE(static_cast<unsigned char>(c) >= 0x20 && c != 0x7F) << text;
    }
}

TEST(SharedModels, AsTheManifestCounts) {
    std::ifstream manifest(data_folder / "MANIFEST.md");
    if (!manifest) GTEST_SKIP() << "no shared data at " << data_folder;
    size_t models = 0;
    for (std::string line; std::getline(manifest, line);) {
        if (!line.starts_with("| models/")) continue;
        const std::vector<std::string> row = cells(line.substr(1), '|');
        if (row.size() < 13) continue; // the appendix names clips only
        ++models;
        const LoadResult r = load_model((data_folder / row[0]).string());
        EXPECT_TRUE(r.ok) << row[0] << ": " << r.error.what;
        if (!r.ok) continue;
        size_t drawn = 0;
        for (const scenes::Mesh& mesh : r.model.meshes) {
            drawn += mesh.indices.size() / 3;
        }
        EXPECT_EQ(r.model.stored_vertices, counts(row[4])[0]) << row[0];
        EXPECT_EQ(r.model.stored_triangles, counts(row[5])[0]) << row[0];
        EXPECT_EQ(drawn, counts(row[5]).back()) << row[0];
        EXPECT_EQ(r.model.meshes_without_normals == 0, row[7] == "yes") << row[0];
        EXPECT_EQ(r.model.clips.empty(), row[9] == "none") << row[0];
        // "Walk 0.7083 s; ..." begins with the first clip.
        if (!r.model.clips.empty()) {
            char duration[32];
            std::snprintf(duration, sizeof duration, "%.4f", r.model.clips[0].duration);
            std::string shown = duration;
            while (shown.back() == '0')
                shown.pop_back();
            if (shown.back() == '.') shown.pop_back();
            const std::string name = r.model.clips[0].name.empty() ? "(unnamed)" : r.model.clips[0].name;
            EXPECT_TRUE(row[9].starts_with(name + " " + shown + " s"))
                << row[0] << ": " << name << " " << shown;
        }
        expect_finite(r.model, row[0]);
    }
    EXPECT_EQ(models, 43u);
}

// The codes of a model's warnings, each once.
std::string warned(const Model& model) {
    std::set<std::string> codes;
    for (const std::string& text : model.warnings) {
        const size_t at = text.rfind('[');
        EXPECT_TRUE(at != std::string::npos && text.ends_with("]")) << text;
        codes.insert(text.substr(at + 1, text.size() - at - 2));
    }
    std::string out;
    for (const std::string& code : codes)
        out += " " + code;
    return out;
}

// bad_policy.tsv: file, outcome. Outcomes: an error's code; `loads`; `warns` and the warnings' codes. A file
// that breaks the format's rules never just loads.
TEST(SharedBadFiles, FollowThePolicy) {
    if (!std::filesystem::exists(data_folder / "bad")) GTEST_SKIP() << "no shared data at " << data_folder;
    std::map<std::string, std::string> policy;
    std::ifstream table(std::filesystem::path(NUSSELT_LOAD_TESTS) / "bad_policy.tsv");
    for (std::string line; std::getline(table, line);) {
        if (line.empty() || line[0] == '#') continue;
        const std::vector<std::string> row = cells(line, '\t');
        ASSERT_EQ(row.size(), 2u) << line;
        policy[row[0]] = row[1];
    }
    size_t files = 0;
    for (const char* folder : {"gltf", "handmade", "mesh"}) {
        for (const auto& entry :
             std::filesystem::recursive_directory_iterator(data_folder / "bad" / folder)) {
            const std::string extension = entry.path().extension().string();
            if (extension != ".gltf" && extension != ".glb" && extension != ".obj" && extension != ".ply" &&
                extension != ".off") {
                continue;
            }
            ++files;
            const std::string name = std::filesystem::relative(entry.path(), data_folder / "bad").string();
            const auto begin = std::chrono::steady_clock::now();
            const LoadResult r = load_model(entry.path().string());
            const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
            EXPECT_LT(seconds.count(), 10.0) << name;
            const std::string outcome = !r.ok                      ? r.error.code
                                        : r.model.warnings.empty() ? "loads"
                                                                   : "warns" + warned(r.model);
            EXPECT_EQ(outcome, policy[name]) << name << ": " << r.error.what;
            if (r.ok) {
                expect_finite(r.model, name);
                for (const std::string& warning : r.model.warnings) {
                    expect_clean(warning);
                }
            } else {
                const std::string text = describe("file.glb", r.error);
                expect_clean(text);
                EXPECT_LE(text.size(), 200u) << text;
            }
        }
    }
    EXPECT_EQ(files, policy.size());
}

} // namespace
} // namespace nusselt::load::test
