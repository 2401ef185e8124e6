#include "tools/commands/commands.h"
#include "tools/commands/demo_crowd.h"
#include "tools/commands/demo_page.h"
#include "tools/render/render.h"
#include "tools/report/base64.h"
#include "tools/report/failure.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>
#include <fstream>

namespace nusselt::tools {

namespace {

using Json = nlohmann::ordered_json;

struct Scale {
    uint32_t width, height, frames, rays, runs;
};
constexpr Scale full_scale{480, 440, 14, 1024, 5};
constexpr Scale quick_scale{160, 140, 2, 256, 1};
constexpr CrowdScale full_crowd{640, 400, 1024, 5};
constexpr CrowdScale quick_crowd{160, 100, 256, 1};

// Table 1 of the paper: Kautz, Lehtinen, Aila 2004.
struct PaperRow {
    const char* name;
    uint32_t vertices, triangles;
    double error;
};
constexpr PaperRow paper_table[] = {{"cloth", 1378, 2560, 0.0247},
                                    {"fight", 2978, 4806, 0.0793},
                                    {"chess", 1897, 3704, 0.0289},
                                    {"hand", 8636, 15854, 0.0382}};

std::string processor() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);) {
        if (!line.starts_with("model name")) continue;
        const size_t colon = line.find(": ");
        if (colon != std::string::npos) return printable(line.substr(colon + 2));
    }
    return "an unnamed processor";
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
}

struct Totals {
    double ms = 0, us = 0, mean = 0, p99 = 0, clear_mean = 0, clear_p99 = 0;
};

Json show_scene(const scenes::Scene& scene, const PaperRow& paper, const Scale& scale,
                const EngineOptions& options, const Image& environment, OutputDirectory& out,
                Progress& progress, double begin, double share, std::string& engine_text) {
    Engine engine(scene, options, scene.name);
    engine_text = std::string(isa_name(engine.isa())) + ", " + std::to_string(engine.threads()) +
                  (engine.threads() == 1 ? " thread" : " threads");
    const std::vector<float> light = project_environment(environment, "sky");

    std::vector<double> times;
    for (uint32_t k = 0; k < scale.frames; ++k)
        times.push_back(scene.duration * k / scale.frames);
    scenes::Pose pose;
    Framing framing = make_framing(scene.view_direction, 32, scale.width, scale.height);
    for (const double time : times) {
        scene.pose(time, pose);
        for (const std::vector<glm::vec3>& positions : pose.positions)
            include(framing, positions);
    }
    const Camera camera = frame_camera(framing);

    Json frames = Json::array();
    Totals totals;
    double noise = 0;
    float exposure = 0;
    size_t vertices = 0, triangles = 0;
    std::vector<float> transfer;
    for (size_t k = 0; k < times.size(); ++k) {
        throw_if_interrupted();
        progress.show(begin + share * static_cast<double>(k) / static_cast<double>(times.size()), scene.name);
        scene.pose(times[k], pose);
        const Assembly all = assemble(scene, pose);
        vertices = all.positions.size();
        triangles = all.indices.size() / 3;

        if (k == 0) engine.frame(pose, Quality::standard, transfer);
        std::vector<double> ms, us;
        for (uint32_t run = 0; run < scale.runs; ++run) {
            const FrameStats stats = engine.frame(pose, Quality::standard, transfer);
            ms.push_back(stats.wall_ms);
            us.push_back(stats.receivers_computed ? 1e3 * stats.cpu_ms / stats.receivers_computed : 0);
        }

        const TraceScene traced = make_trace_scene(all);
        TraceOptions trace;
        trace.rays = scale.rays;
        trace.cancel = &interrupted();
        std::vector<float> reference = trace_transfer(traced, all, trace).transfer;
        if (k == 0) {
            // Two references differ by the root of 2 times the noise of one.
            trace.seed = 2;
            noise = transfer_error(trace_transfer(traced, all, trace).transfer, reference).mean /
                    1.4142135623730951;
        }
        TraceOptions lifted = trace;
        lifted.rays = scale.rays / 4;
        lifted.lift = clear_lift;
        const std::vector<uint8_t> clear =
            clear_receivers(reference, trace_transfer(traced, all, lifted).transfer);
        throw_if_interrupted();
        const TransferError error = transfer_error(transfer, reference);
        const TransferError clear_error = transfer_error(transfer, reference, clear);

        const View view = cast_view(traced, camera, scale.width, scale.height);
        std::vector<float> open = open_transfers(all.normals);
        const auto colored = [&](std::vector<float>& of, const std::vector<glm::vec3>& albedo) {
            return color_view(view, all, engine.shade(light.data(), of, albedo));
        };
        // As in run_render.
        if (k == 0) {
            const std::vector<glm::vec3> white(vertices, glm::vec3(1));
            exposure = exposure_for(colored(open, white), view.covered);
        }
        const Picture pictures[3] = {finish_view(view, colored(open, all.albedo), exposure, nullptr),
                                     finish_view(view, colored(transfer, all.albedo), exposure, nullptr),
                                     finish_view(view, colored(reference, all.albedo), exposure, nullptr)};
        char name[64];
        std::snprintf(name, sizeof name, "frames/%s_%02zu.png", scene.name.c_str(), k);
        out.add(name, encode_png(beside({&pictures[0], &pictures[1], &pictures[2]}, 6)));

        const double frame_ms = median(ms), vertex_us = median(us);
        Json images = Json::array();
        for (const Picture& picture : pictures)
            images.push_back(base64(encode_jpeg(picture, 88)));
        frames.push_back({{"time", times[k]},
                          {"ms", frame_ms},
                          {"us", vertex_us},
                          {"mean", error.mean},
                          {"p99", error.p99},
                          {"clear_mean", clear_error.mean},
                          {"clear_p99", clear_error.p99},
                          {"images", std::move(images)}});
        const double part = 1.0 / static_cast<double>(times.size());
        totals.ms += part * frame_ms;
        totals.us += part * vertex_us;
        totals.mean += part * error.mean;
        totals.p99 += part * error.p99;
        totals.clear_mean += part * clear_error.mean;
        totals.clear_p99 += part * clear_error.p99;
    }
    return {{"name", scene.name},
            {"vertices", vertices},
            {"triangles", triangles},
            {"duration", scene.duration},
            {"frame_ms", totals.ms},
            {"us_per_vertex", totals.us},
            {"error_mean", totals.mean},
            {"error_p99", totals.p99},
            {"clear_mean", totals.clear_mean},
            {"clear_p99", totals.clear_p99},
            {"noise", noise},
            {"paper", {{"vertices", paper.vertices}, {"triangles", paper.triangles}, {"error", paper.error}}},
            {"frames", std::move(frames)}};
}

} // namespace

void run_demo(const DemoOptions& options) {
    const Scale& scale = options.quick ? quick_scale : full_scale;
    OutputDirectory out(options.out);
    const Image environment = sky(256, 128, 0);

    Json data;
    data["width"] = scale.width;
    data["height"] = scale.height;
    data["scenes"] = Json::array();
    std::string engine_text;
    {
        Progress progress("demo");
        // By the time that each takes: most of it goes into rays.
        double all_vertices = 0, done = 0;
        for (const PaperRow& row : paper_table)
            all_vertices += row.vertices;
        const double crowd_vertices = 3000; // traced once, where a scene is in every frame
        all_vertices += crowd_vertices;
        for (const PaperRow& row : paper_table) {
            const scenes::Scene scene = scenes::builtin(row.name);
            if (scene.meshes.empty())
                throw Failure(row.name, "is no built-in scene of this build; build it again");
            data["scenes"].push_back(show_scene(scene, row, scale, options.engine, environment, out, progress,
                                                done / all_vertices, row.vertices / all_vertices,
                                                engine_text));
            done += row.vertices;
        }
        progress.show(done / all_vertices, "crowd");
        data["crowd"] = show_crowd(scenes::builtin("fight"), options.quick ? quick_crowd : full_crowd,
                                   options.engine, environment, out);
    }
    const std::string machine = processor() + "; " + engine_text;
    data["machine"] = machine;
    data["notes"] = {
        "Milliseconds a frame and CPU microseconds a vertex (summed over threads, per receiver computed): "
        "quality "
        "standard, median of " +
            std::to_string(scale.runs) + " runs of each frame, on " + machine + ".",
        "Error: relative L2 distance of the 25-term transfer vectors to ray-traced ones (Embree, " +
            std::to_string(scale.rays) +
            " jittered rays a vertex), over the vertices that see at least 1 %: mean and 99th percentile, "
            "each averaged "
            "over the frames. The reference's own noise, told by a second set of rays, is part of it.",
        "Clear: the vertices that touch no other surface: they see at least 10 %, and the reference moves "
        "less than 10 % "
        "when it is lifted by 2e-4 of the scene's diagonal. Where surfaces touch, the truth itself flips "
        "between open "
        "and dark within rounding.",
        "All three pictures: ray-cast primary visibility, radiance per vertex from the dot product with the "
        "sky's 25 "
        "coefficients, one exposure, taken from the unshadowed surface in white.",
        "The crowd: one frame with every boxer as an object of its own; processor time, the same for each "
        "boxer alone "
        "and for all as one object. Far objects are drawn once for many receivers and multiplied into their "
        "transfer "
        "vectors, near ones coarsely into their masks.",
        "In brackets and in the last column: Table 1 of Kautz, Lehtinen, Aila 2004, Hemispherical "
        "Rasterization for "
        "Self-Shadowing of Dynamic Objects. Its scenes are not published; ours are made to its sizes.",
        std::string(configuration())};
    out.add("index.html", demo_page(data));

    Json table = data;
    for (Json& scene : table["scenes"])
        for (Json& frame : scene["frames"])
            frame.erase("images");
    table["crowd"].erase("images");
    table["crowd"].erase("plot");
    out.add("table.json", table.dump(2) + "\n");
    out.commit();

    std::printf("%-8s %9s %10s %11s %12s %11s %10s %10s %14s\n", "scene", "vertices", "triangles",
                "ms a frame", "us a vertex", "error mean", "error p99", "clear p99", "paper's error");
    for (const Json& scene : data["scenes"]) {
        std::printf("%-8s %9llu %10llu %11.2f %12.2f %9.2f %% %8.2f %% %8.2f %% %12.2f %%\n",
                    scene["name"].get<std::string>().c_str(), scene["vertices"].get<unsigned long long>(),
                    scene["triangles"].get<unsigned long long>(), scene["frame_ms"].get<double>(),
                    scene["us_per_vertex"].get<double>(), 100 * scene["error_mean"].get<double>(),
                    100 * scene["error_p99"].get<double>(), 100 * scene["clear_p99"].get<double>(),
                    100 * scene["paper"]["error"].get<double>());
    }
    const Json& crowd = data["crowd"];
    std::printf("crowd    %9llu %10llu %11.2f: %u objects, %.2f x their times alone, clear error %.2f %% "
                "(alone %.2f %%)\n",
                crowd["vertices"].get<unsigned long long>(), crowd["triangles"].get<unsigned long long>(),
                crowd["cpu_ms"].get<double>(), crowd_objects, crowd["over_alone"].get<double>(),
                100 * crowd["clear_mean"].get<double>(), 100 * crowd["alone_clear_mean"].get<double>());
    std::printf("on %s\n%s/index.html\n", machine.c_str(), printable(out.path()).c_str());
}

} // namespace nusselt::tools
