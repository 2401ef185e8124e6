// Hashes of transfer vectors and masks of the built-in scenes, the same on every machine, for every
// instruction set and number of threads. `golden_test --update` writes them anew.
#include "tests/runtime/fixture.h"

#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>

namespace nusselt::test {

namespace {

constexpr double times[] = {0.2, 0.7}; // of the clip
constexpr Quality qualities[] = {Quality::paper, Quality::draft, Quality::standard, Quality::fine};

// "scene time quality" -> hash
using Hashes = std::map<std::string, std::string>;

// Only every `stride`-th entry, the first one `first`.
Hashes compute(Context* context, uint32_t first = 0, uint32_t stride = 1) {
    Hashes all;
    uint32_t entry = 0;
    for (const std::string& name : scenes::builtin_names()) {
        const scenes::Scene scene = scenes::builtin(name);
        const std::vector<MeshId> ids = add_all(context, scene);
        for (const double time : times) {
            for (const Quality quality : qualities) {
                if (entry++ % stride != first) continue;
                const uint64_t h =
                    hash(run_frame(context, posed(scene, ids, time * scene.duration), quality));
                char key[64], text[24];
                std::snprintf(key, sizeof(key), "%s %.1f %s", name.c_str(), time, quality_name(quality));
                std::snprintf(text, sizeof(text), "%016llx", static_cast<unsigned long long>(h));
                all[key] = text;
            }
        }
        for (const MeshId id : ids)
            EXPECT_TRUE(remove_mesh(context, id).ok());
    }
    return all;
}

Hashes stored() {
    Hashes all;
    std::ifstream file(NUSSELT_GOLDEN);
    for (std::string line; std::getline(file, line);) {
        const size_t space = line.rfind(' ');
        if (line.empty() || line[0] == '#' || space == std::string::npos) continue;
        all[line.substr(0, space)] = line.substr(space + 1);
    }
    return all;
}

void compare(const Hashes& ours, const char* what) {
    const Hashes wanted = stored();
    for (const auto& [key, value] : ours) {
        const auto found = wanted.find(key);
        ASSERT_NE(found, wanted.end()) << key << ": not in " NUSSELT_GOLDEN "; run golden_test --update";
        EXPECT_EQ(value, found->second)
            << key << " with " << what
            << ": results have changed. If that is meant, run golden_test --update and add a line under "
               "'Results changed' in CHANGELOG.md that says why; if not, this is a bug";
    }
}

TEST(Golden, FileHasEveryEntry) {
    EXPECT_EQ(stored().size(), scenes::builtin_names().size() * std::size(times) * std::size(qualities));
}

TEST(Golden, BestIsa) {
    Engine engine;
    compare(compute(engine.context), isa_name(context_isa(engine.context)));
}

TEST(Golden, EveryOtherIsa) {
    const std::vector<Isa> isas = available_isas();
    for (const Isa isa : isas) {
        if (isa == isas.back()) continue;
        Engine engine(with_isa(isa));
        // The reference is slow: every fifth entry, which are all scenes and qualities.
        compare(isa == Isa::scalar ? compute(engine.context, 1, 5) : compute(engine.context), isa_name(isa));
    }
}

TEST(Golden, EveryNumberOfThreads) {
    for (const uint32_t threads : {1u, 2u, 8u}) {
        Executor executor;
        const Status status = create_tbb_executor(threads, &executor);
        if (status.code == StatusCode::unsupported) GTEST_SKIP() << status.text;
        ASSERT_TRUE(status.ok()) << status.text;
        {
            ContextDesc desc;
            desc.executor = executor;
            Engine engine(desc);
            compare(compute(engine.context, threads % 3, 3), (std::to_string(threads) + " threads").c_str());
        }
        destroy_executor(&executor);
    }
}

bool update() {
    Engine engine;
    std::ofstream file(NUSSELT_GOLDEN);
    file << "# scene, part of its clip, quality, hash of transfer vectors and masks. Written by golden_test "
            "--update;\n# a change of a hash is a line under 'Results changed' in CHANGELOG.md.\n";
    for (const auto& [key, value] : compute(engine.context))
        file << key << ' ' << value << '\n';
    file.close();
    return bool(file);
}

} // namespace

} // namespace nusselt::test

int main(int argc, char** argv) {
    testing::InitGoogleTest(&argc, argv);
    if (argc == 2 && std::strcmp(argv[1], "--update") == 0) {
        const bool written = nusselt::test::update();
        std::printf("%s " NUSSELT_GOLDEN "; say why in CHANGELOG.md\n", written ? "wrote" : "cannot write");
        return written ? 0 : 1;
    }
    return RUN_ALL_TESTS();
}
