// The whole way, from posed meshes to transfer vectors, against rays: mean relative error of the transfer.
#include "tests/runtime/fixture.h"

#include "tools/load/model.h"
#include "tools/trace/trace.h"

#include <filesystem>

namespace nusselt::test {

namespace {

tools::TransferError error_of(const scenes::Scene& scene, double time, Quality quality) {
    scenes::Pose pose;
    scene.pose(time, pose);
    const tools::Assembly all = tools::assemble(scene, pose);
    tools::TraceOptions options;
    options.rays = 1024;
    const tools::TraceScene traced_scene = tools::make_trace_scene(all);
    const std::vector<float> traced = trace_transfer(traced_scene, all, options).transfer;
    options.lift = tools::clear_lift;
    const std::vector<float> lifted = trace_transfer(traced_scene, all, options).transfer;
    Engine engine;
    const Outputs out = run_scene(engine.context, scene, time, quality);
    std::vector<float> ours;
    for (const Output& o : out.meshes) {
        for (const auto& t : o.transfer)
            ours.insert(ours.end(), t.begin(), t.end());
    }
    // A receiver that touches another surface has no answer to agree on: told, but not bounded.
    const tools::TransferError everyone = tools::transfer_error(ours, traced);
    const tools::TransferError error =
        tools::transfer_error(ours, traced, tools::clear_receivers(traced, lifted));
    std::printf(
        "    %s at %.2f s, %s: clear mean %.2f %% p99 %.1f max %.0f over %u receivers; all %.2f %% p99 "
        "%.1f over %u\n",
        scene.name.c_str(), time, quality_name(quality), 100 * error.mean, 100 * error.p99, 100 * error.max,
        error.receivers, 100 * everyone.mean, 100 * everyone.p99, everyone.receivers);
    EXPECT_GT(error.receivers, everyone.receivers / 2);
    return error;
}

// The rays' own noise, about 1 %, is part of these.
constexpr double standard_bound = 0.022, paper_bound = 0.09;

void expect_standard(const scenes::Scene& scene, double time) {
    const tools::TransferError error = error_of(scene, time, Quality::standard);
    EXPECT_LE(error.mean, standard_bound) << scene.name;
    EXPECT_LE(error.p99, 0.06) << scene.name;
    EXPECT_LE(error.max, 0.15) << scene.name;
}

TEST(Error, BuiltInScenes) {
    for (const char* name : {"fight", "chess"}) {
        const scenes::Scene scene = scenes::builtin(name);
        for (const double part : {0.25, 0.75}) {
            const double time = part * scene.duration;
            expect_standard(scene, time);
            EXPECT_LE(error_of(scene, time, Quality::paper).mean, paper_bound) << name;
        }
    }
}

TEST(Error, Spot) {
    const std::filesystem::path file =
        std::filesystem::path(NUSSELT_SHARED_DIR) / "data/models/classic/spot_cow/spot.obj";
    if (!std::filesystem::exists(file)) GTEST_SKIP() << "not here: " << file;
    const load::LoadResult loaded = load::load_model(file.string());
    ASSERT_TRUE(loaded.ok);
    const scenes::Scene scene = load::make_scene(loaded.model, -1);
    expect_standard(scene, 0);
    EXPECT_LE(error_of(scene, 0, Quality::paper).mean, paper_bound);
}

} // namespace

} // namespace nusselt::test
