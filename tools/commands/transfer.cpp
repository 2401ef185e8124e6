#include "tools/commands/choice.h"
#include "tools/commands/commands.h"
#include "tools/commands/pvs.h"
#include "tools/report/failure.h"
#include "tools/report/npy.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"
#include "tools/trace/assembly.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

namespace {

using Json = nlohmann::ordered_json;

template<class Value>
Json min_and_median(const std::vector<FrameStats>& frames, const Value& value) {
    std::vector<double> values;
    for (const FrameStats& frame : frames)
        values.push_back(value(frame));
    std::sort(values.begin(), values.end());
    const size_t half = values.size() / 2;
    const double median = values.size() % 2 ? values[half] : (values[half - 1] + values[half]) / 2;
    return {{"min", values.front()}, {"median", median}};
}

} // namespace

void run_transfer(const TransferOptions& options) {
    const Choice choice = choose(options.model, options.clip, options.time.has_value());
    const double time = options.time.value_or(0);
    check_time(choice, time, "--time");
    OutputDirectory out(options.out);

    scenes::Pose pose;
    choice.scene.pose(time, pose);
    Engine engine(choice.scene, options.engine, options.model);
    if (!options.visible_set.empty()) {
        engine.use_visible(read_set(options.visible_set), options.visible_set);
        engine.choose_segment(segment_at(time, choice.scene.duration, engine.visible_info().segments));
    }
    std::vector<float> transfer;
    std::vector<uint32_t> masks;
    std::vector<StreamArray> streams = options.streams;
    BackArrays backs;
    backs.streams = streams;
    engine.see_backs(options.two_sided, &backs);
    std::vector<FrameStats> frames;
    {
        Progress progress("transfer");
        // The first frame of several pays for memory that the others find there.
        if (options.repeat > 1) engine.frame(pose, options.quality, transfer, &masks, &streams);
        for (uint32_t k = 0; k < options.repeat; ++k) {
            throw_if_interrupted();
            frames.push_back(engine.frame(pose, options.quality, transfer, &masks, &streams));
            progress.show((k + 1.0) / options.repeat);
        }
    }

    const Assembly all = assemble(choice.scene, pose);
    const size_t vertices = all.positions.size();
    out.add("positions.npy", npy(&all.positions[0].x, {vertices, 3}));
    out.add("normals.npy", npy(&all.normals[0].x, {vertices, 3}));
    out.add("indices.npy", npy(all.indices.data(), {all.indices.size() / 3, 3}));
    out.add("transfer.npy", npy(transfer.data(), {vertices, 25}));
    const size_t words = quality_mask_bits(options.quality) / 32;
    out.add("masks.npy", npy(masks.data(), {vertices, words}));
    if (options.two_sided != TwoSided::off) {
        out.add("transfer_back.npy", npy(backs.transfer.data(), {vertices, 25}));
        out.add("masks_back.npy", npy(backs.masks.data(), {vertices, words}));
        for (const StreamArray& stream : backs.streams)
            out.add(stream_name(stream) + "_back.npy", stream_npy(stream));
    }

    Json written = Json::array();
    for (const StreamArray& stream : streams) {
        const std::string name = stream_name(stream);
        out.add(name + ".npy", stream_npy(stream));
        Json entry = {{"name", name}, {"bytes_a_vertex", stream.element()}};
        if (stream.kind == OutputKind::transfer) {
            const FormatError error = format_error(stream, transfer);
            entry["format_error_mean"] = error.mean;
            entry["format_error_p99"] = error.p99;
        }
        written.push_back(entry);
    }

    const FrameStats& last = frames.back();
    const auto stage = [&](double FrameStats::*member) {
        return min_and_median(frames, [&](const FrameStats& s) { return s.*member; });
    };
    Json stats;
    stats["model"] = options.model;
    stats["clip"] =
        choice.clip < 0 ? Json() : Json(choice.model.clips[static_cast<size_t>(choice.clip)].name);
    stats["clip_number"] = choice.clip < 0 ? Json() : Json(choice.clip);
    stats["time"] = time;
    stats["quality"] = quality_name(options.quality);
    stats["mask_bits"] = quality_mask_bits(options.quality);
    stats["isa"] = isa_name(engine.isa());
    stats["threads"] = engine.threads();
    stats["repeat"] = options.repeat;
    stats["meshes"] = choice.scene.meshes.size();
    stats["vertices"] = vertices;
    stats["triangles"] = all.indices.size() / 3;
    stats["frame_ms"] = stage(&FrameStats::wall_ms);
    stats["us_per_vertex"] = min_and_median(frames, [](const FrameStats& s) {
        return s.receivers_computed ? 1e3 * s.cpu_ms / s.receivers_computed : 0;
    });
    stats["counts"] = {{"receivers", last.receivers},
                       {"receivers_computed", last.receivers_computed},
                       {"receivers_copied", last.receivers_copied},
                       {"receivers_inside", last.receivers_inside},
                       {"receivers_invalid", last.receivers_invalid},
                       {"clusters_tested", last.clusters_tested},
                       {"clusters_rasterized", last.clusters_rasterized},
                       {"triangles_considered", last.triangles_considered},
                       {"triangles_rasterized", last.triangles_rasterized},
                       {"triangles_invalid", last.triangles_invalid},
                       {"fan_triangles", last.fan_triangles},
                       {"blocks_uniform", last.blocks_uniform},
                       {"blocks_partial", last.blocks_partial}};
    stats["stage_ms"] = {
        {"cpu", stage(&FrameStats::cpu_ms)},       {"refit", stage(&FrameStats::refit_ms)},
        {"cull", stage(&FrameStats::cull_ms)},     {"transform", stage(&FrameStats::transform_ms)},
        {"raster", stage(&FrameStats::raster_ms)}, {"integrate", stage(&FrameStats::integrate_ms)},
        {"rotate", stage(&FrameStats::rotate_ms)}};
    stats["outputs"] = written;
    stats["build"] = configuration();
    out.add("stats.json", stats.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
    out.commit();

    std::printf(
        "%s: %zu vertices, %zu triangles, quality %s, %s, %u thread%s: %.3f ms a frame, %.3f us a vertex\n",
        printable(out.path()).c_str(), vertices, all.indices.size() / 3, quality_name(options.quality),
        isa_name(engine.isa()), engine.threads(), engine.threads() == 1 ? "" : "s",
        stats["frame_ms"]["median"].get<double>(), stats["us_per_vertex"]["median"].get<double>());
}

} // namespace nusselt::tools
