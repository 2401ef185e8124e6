// Every kept input once: the seeds, and whatever a fuzzer ever broke something with.
#include "tests/fuzz/fuzz.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

namespace nusselt::fuzz {

namespace {

namespace fs = std::filesystem;

struct Target {
    const char* name;
    int (*run)(const uint8_t*, size_t);
};
constexpr Target targets[] = {
    {"gltf", gltf}, {"gltf_struct", gltf_struct}, {"glb", glb}, {"skin", skin},           {"hdr", hdr},
    {"exr", exr},   {"obj_ply", obj_ply},         {"sh", sh},   {"mask_diff", mask_diff}, {"api", api},
    {"cli", cli},   {"visible_set", visible_set}};

class Replay : public testing::TestWithParam<Target> {};

TEST_P(Replay, KeptInputs) {
    size_t count = 0;
    for (const char* kind : {"seeds", "regress"}) {
        const fs::path folder = fs::path(NUSSELT_FUZZ_DIR) / kind / GetParam().name;
        if (!fs::exists(folder)) continue;
        std::vector<fs::path> files;
        for (const auto& entry : fs::directory_iterator(folder))
            files.push_back(entry.path());
        std::sort(files.begin(), files.end());
        for (const fs::path& path : files) {
            std::ifstream file(path, std::ios::binary);
            const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
            SCOPED_TRACE(path.filename().string());
            // An array of its own, so that a step too far is seen.
            const std::vector<uint8_t> input(bytes.begin(), bytes.end());
            GetParam().run(input.data(), input.size());
            ++count;
        }
    }
    EXPECT_GT(count, 0u) << "seeds are missing";
}

INSTANTIATE_TEST_SUITE_P(Targets, Replay, testing::ValuesIn(targets),
                         [](const auto& target) { return std::string(target.param.name); });

} // namespace

} // namespace nusselt::fuzz
