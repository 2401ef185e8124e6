// FrameDesc::watertight on real models, closed ones and sheets: what is nearly enclosed gets darker, and
// nothing else changes.
#include "tests/runtime/fixture.h"

#include "tools/load/model.h"

#include <cstdio>
#include <filesystem>

namespace nusselt::test {

namespace {

namespace fs = std::filesystem;

const fs::path models = fs::path(NUSSELT_SHARED_DIR) / "data/models";

// Nowhere a bit changes but from open to blocked, and only in masks of which at most 1 in 16 is open.
void expect_nearly_closed_masks_alone(const scenes::Scene& scene, double time, Quality quality) {
    SCOPED_TRACE(scene.name + ", " + quality_name(quality));
    Engine engine;
    const std::vector<Posed> frame = posed(scene, add_all(engine.context, scene), time);
    FrameDesc settings;
    settings.quality = quality;
    const Outputs loose = run_frame(engine.context, frame, settings);
    settings.watertight = true;
    const Outputs tight = run_frame(engine.context, frame, settings);
    const uint32_t bits = quality_mask_bits(quality), words = bits / 32;
    uint64_t receivers = 0, nearly = 0, changed = 0, gained = 0;
    for (size_t m = 0; m < frame.size(); ++m) {
        for (size_t v = 0; v < loose.meshes[m].transfer.size(); ++v) {
            ++receivers;
            const uint32_t before = blocked_bits(loose.meshes[m], v, quality),
                           after = blocked_bits(tight.meshes[m], v, quality);
            if (before < bits - bits / 16) {
                ASSERT_TRUE(same_result(loose.meshes[m], tight.meshes[m], v)) << "mesh " << m << ", " << v;
                continue;
            }
            ++nearly;
            changed += after != before;
            gained += after - before;
            for (size_t w = v * words; w < (v + 1) * words; ++w)
                ASSERT_EQ(loose.meshes[m].masks[w] & ~tight.meshes[m].masks[w], 0u) << v << " was opened";
        }
    }
    std::printf("    %s, %s: %llu receivers, %llu nearly closed, %llu of these changed by %llu bits\n",
                scene.name.c_str(), quality_name(quality), static_cast<unsigned long long>(receivers),
                static_cast<unsigned long long>(nearly), static_cast<unsigned long long>(changed),
                static_cast<unsigned long long>(gained));
}

TEST(Watertight, ChangesNearlyClosedMasksAlone) {
    for (const char* name : {"hand", "chess", "cloth"}) {
        const scenes::Scene scene = scenes::builtin(name);
        for (const Quality quality : {Quality::standard, Quality::fine})
            expect_nearly_closed_masks_alone(scene, 0.5 * scene.duration, quality);
    }
}

TEST(Watertight, ChangesNearlyClosedMasksOfModelsAlone) {
    if (!fs::exists(models)) GTEST_SKIP() << "not here: " << models;
    for (const char* name :
         {"skinned/mannequiny/mannequiny.glb", "skinned/ghost/ghost_v2.glb",
          "skinned/kaykit_knight/Knight.glb", "rigid/cesium_milk_truck/CesiumMilkTruck.glb",
          "static/sheen_cloth/SheenCloth.glb", "static/mountains/Mountains.gltf",
          "static/palm_tree/PalmTree.gltf"}) {
        const load::LoadResult loaded = load::load_model((models / name).string());
        ASSERT_TRUE(loaded.ok) << name;
        scenes::Scene scene = load::make_scene(loaded.model, -1);
        scene.name = name;
        for (const Quality quality : {Quality::draft, Quality::standard})
            expect_nearly_closed_masks_alone(scene, 0, quality);
    }
}

} // namespace

} // namespace nusselt::test
