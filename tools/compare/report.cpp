#include "tools/compare/report.h"

#include "revision.h"
#include "tools/compare/paper.h"
#include "tools/report/failure.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <fstream>
#include <thread>

namespace nusselt::tools {

namespace {

using Json = nlohmann::ordered_json;

// JSON has no infinity.
Json number(double value) {
    if (std::isfinite(value)) return value;
    return 1e300;
}

[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, pattern);
    std::vsnprintf(text, sizeof text, pattern, arguments);
    va_end(arguments);
    return text;
}

Json to_json(const Distribution& d) {
    return {{"count", d.count},     {"mean", number(d.mean)}, {"median", number(d.median)},
            {"p95", number(d.p95)}, {"p99", number(d.p99)},   {"max", number(d.max)}};
}

Json to_json(const ErrorFigures& figures) {
    Json json = to_json(figures.each);
    json["pooled"] = number(figures.pooled);
    json["below_noise"] = figures.noisy;
    return json;
}

Json to_json(const Time& time) {
    return {{"min", time.min}, {"median", time.median}};
}

const char* outside_name(Outside outside) {
    switch (outside) {
    case Outside::no:
        return "inside";
    case Outside::smaller:
        return "error smaller than the curve's";
    case Outside::larger:
        return "error larger than the curve's";
    }
    return "unknown";
}

Json to_json(const EqualError& equal, const Time& us) {
    return {{"peer_us", equal.time},
            {"speedup", us.min > 0 ? equal.time / us.min : 0},
            {"place", outside_name(equal.outside)}};
}

struct Shares {
    double refit, cull, transform, raster, integrate, rotate, total;
};
Shares shares_of(const FrameStats& s) {
    const double total = s.refit_ms + s.cull_ms + s.transform_ms + s.raster_ms + s.integrate_ms + s.rotate_ms;
    const double scale = total > 0 ? 1 / total : 0;
    return {s.refit_ms * scale,
            s.cull_ms * scale,
            s.transform_ms * scale,
            s.raster_ms * scale,
            s.integrate_ms * scale,
            s.rotate_ms * scale,
            total};
}

Json to_json(const FrameStats& s) {
    const Shares shares = shares_of(s);
    const double receivers = std::max<double>(s.receivers_computed, 1);
    const auto each = [&](uint64_t count) { return static_cast<double>(count) / receivers; };
    return {{"counters",
             {{"receivers", s.receivers},
              {"receivers_computed", s.receivers_computed},
              {"receivers_copied", s.receivers_copied},
              {"receivers_inside", s.receivers_inside},
              {"receivers_invalid", s.receivers_invalid},
              {"clusters_tested", s.clusters_tested},
              {"clusters_rasterized", s.clusters_rasterized},
              {"triangles_considered", s.triangles_considered},
              {"triangles_rasterized", s.triangles_rasterized},
              {"fan_triangles", s.fan_triangles},
              {"blocks_uniform", s.blocks_uniform},
              {"blocks_partial", s.blocks_partial},
              {"triangles_invalid", s.triangles_invalid}}},
            {"per_receiver",
             {{"triangles_considered", each(s.triangles_considered)},
              {"triangles_rasterized", each(s.triangles_rasterized)},
              {"fan_triangles", each(s.fan_triangles)},
              {"blocks_partial", each(s.blocks_partial)}}},
            {"stages",
             {{"refit", shares.refit},
              {"cull", shares.cull},
              {"transform", shares.transform},
              {"raster", shares.raster},
              {"integrate", shares.integrate},
              {"rotate", shares.rotate}}}};
}

Json to_json(const Entry& entry, const SceneReport& scene) {
    Json json{{"name", entry.name}, {"kind", kind_name(entry.kind)}, {"samples", entry.samples}};
    json["error"] = {{"all", to_json(entry.all)}, {"clear", to_json(entry.clear)}};
    json["absolute"] = to_json(entry.absolute);
    json["ambient_occlusion"] = to_json(entry.ambient);
    json["temporal"] = to_json(entry.change);
    json["temporal"]["below_noise"] = entry.change.count > 0 && entry.change.mean <= scene.noise.change;
    json["radiance"] = Json::object();
    for (size_t k = 0; k < entry.radiance.size(); ++k) {
        json["radiance"][scene.lights[k]] = {{"relative_rms", number(entry.radiance[k].relative)},
                                             {"max_over_brightest", number(entry.radiance[k].max)}};
    }
    json["histogram"] = {{"all", entry.histogram_all}, {"clear", entry.histogram_clear}};
    if (entry.kind == Kind::floor) return json;
    json["us_per_vertex"] = to_json(entry.us);
    json["frame_ms"] = to_json(entry.wall_ms);
    json["fps"] = entry.wall_ms.median > 0 ? 1e3 / entry.wall_ms.median : 0;
    json["equal_error"] = {{"all", to_json(entry.peer_all, entry.us)},
                           {"clear", to_json(entry.peer_clear, entry.us)}};
    if (entry.stats) json["work"] = to_json(*entry.stats);
    if (entry.kind == Kind::peer) {
        json["update_ms"] = to_json(entry.update_ms);
        json["setup"] = entry.setup;
    }
    json["worst"] = Json::array();
    for (const Worst& worst : entry.worst) {
        json["worst"].push_back({{"frame", worst.frame},
                                 {"vertex", worst.vertex},
                                 {"error", number(worst.error)},
                                 {"seen", worst.seen},
                                 {"clear", worst.clear}});
    }
    return json;
}

Json to_json(const SceneReport& scene) {
    Json json{{"name", printable(scene.name)},
              {"complete", scene.complete},
              {"repeats", scene.repeats},
              {"vertices", scene.vertices},
              {"triangles", scene.triangles},
              {"receivers", scene.receivers},
              {"levels", scene.levels},
              {"coarse_triangles", scene.coarse_triangles},
              {"isa", scene.isa},
              {"times", scene.times}};
    json["reference"] = {{"rays", scene.reference_rays},
                         {"receivers_per_frame", scene.reference_receivers},
                         {"seconds", scene.reference_seconds},
                         {"counted", scene.noise.all.count},
                         {"clear", scene.noise.clear.count},
                         {"dark", scene.noise.dark},
                         {"noise",
                          {{"all", to_json(scene.noise.all)},
                           {"clear", to_json(scene.noise.clear)},
                           {"temporal_mean", scene.noise.change}}}};
    json["memory"] = {{"mesh_bytes", scene.mesh_bytes},
                      {"context_bytes", scene.context_bytes},
                      {"peer_bytes", scene.peer_bytes}};
    json["add_mesh_ms"] = scene.add_mesh_ms;
    json["peer"] = {{"build_ms", scene.peer_build_ms},
                    {"refit_ms", scene.peer_refit_ms},
                    {"receivers_timed_per_frame", scene.peer_receivers}};
    json["entries"] = Json::array();
    for (const Entry& entry : scene.entries)
        json["entries"].push_back(to_json(entry, scene));
    json["scaling"] = Json::array();
    for (const ScalingPoint& point : scene.scaling) {
        json["scaling"].push_back({{"entry", point.entry},
                                   {"threads", point.threads},
                                   {"threads_that_took_part", point.took_part},
                                   {"frame_ms", to_json(point.wall_ms)},
                                   {"us_per_vertex", to_json(point.us)},
                                   {"hash", format("%016llx", static_cast<unsigned long long>(point.hash))}});
    }
    json["notes"] = scene.notes;
    return json;
}

const Entry* find(const SceneReport& scene, std::string_view name) {
    for (const Entry& entry : scene.entries)
        if (entry.name == name) return &entry;
    return nullptr;
}

std::string percent(double value, bool marked = false) {
    if (!std::isfinite(value)) return "inf";
    return format(marked ? "<%.2f" : "%.2f", 100 * value);
}

// What is below the noise of the reference is told as such: "<" and the noise.
std::string percent(const ErrorFigures& figures, const Distribution& noise) {
    return figures.noisy ? percent(noise.mean, true) : percent(figures.each.mean);
}

std::string speedup(const EqualError& equal, const Time& us) {
    if (!(us.min > 0) || !(equal.time > 0)) return "";
    const char* mark = equal.outside == Outside::smaller  ? ">="
                       : equal.outside == Outside::larger ? "<="
                                                          : "";
    return format("%s%.1f", mark, equal.time / us.min);
}

std::string pad(const std::string& text, int width) {
    return format("%*s", width, text.c_str());
}

} // namespace

std::string processor_name() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);) {
        if (!line.starts_with("model name")) continue;
        const size_t colon = line.find(": ");
        if (colon != std::string::npos) return printable(line.substr(colon + 2));
    }
    return "an unnamed processor";
}

const char* source_revision() {
    return NUSSELT_REVISION;
}

Json report_json(const Comparison& comparison) {
    const MeasureOptions& options = comparison.options;
    Json json{{"schema", report_schema}, {"complete", comparison.complete}, {"seconds", comparison.seconds}};
    json["build"] = {
        {"configuration", configuration()}, {"compiler", __VERSION__}, {"revision", source_revision()}};
    json["machine"] = {{"processor", processor_name()},
                       {"hardware_threads", std::thread::hardware_concurrency()}};
    json["settings"] = {{"command", printable(comparison.command)},
                        {"threads", options.threads},
                        {"frames", options.frames},
                        {"repeats", options.repeats},
                        {"reference_rays", options.reference_rays},
                        {"most_receivers", options.most_receivers},
                        {"limit_seconds", options.limit_seconds}};
    json["histogram"] = {
        {"low_decade", histogram_low}, {"bins_per_decade", histogram_per}, {"bins", histogram_bins}};
    json["scenes"] = Json::array();
    for (const SceneReport& scene : comparison.scenes)
        json["scenes"].push_back(to_json(scene));
    json["failures"] = Json::array();
    for (const Unmeasured& failure : comparison.failures)
        json["failures"].push_back(
            {{"name", printable(failure.name)}, {"reason", printable(failure.reason)}});
    json["sizes"] = Json::array();
    for (const SizePoint& point : comparison.sizes) {
        json["sizes"].push_back({{"entry", point.entry},
                                 {"vertices", point.vertices},
                                 {"triangles", point.triangles},
                                 {"receivers", point.receivers},
                                 {"us_per_vertex", to_json(point.us)},
                                 {"frame_ms", to_json(point.wall_ms)},
                                 {"triangles_rasterized", point.triangles_rasterized}});
    }
    json["studies"] = Json::array();
    for (const StudyReport& study : comparison.studies) {
        json["studies"].push_back({{"scene", printable(study.scene)},
                                   {"topic", study.topic},
                                   {"columns", study.table.columns},
                                   {"rows", study.table.rows}});
    }
    json["paper"] = Json::array();
    for (const PaperRow& row : paper_rows) {
        json["paper"].push_back({{"name", row.name},
                                 {"vertices", row.vertices},
                                 {"triangles", row.triangles},
                                 {"coarse_triangles", row.coarse_triangles},
                                 {"triangles_rasterized", row.rasterized},
                                 {"fps", row.fps},
                                 {"triangles_rasterized_pvs", row.rasterized_pvs},
                                 {"fps_pvs", row.fps_pvs},
                                 {"error", row.error},
                                 {"stages",
                                  {{"raster", row.shares[0]},
                                   {"integrate", row.shares[1]},
                                   {"transform", row.shares[2]},
                                   {"other", row.shares[3]}}}});
    }
    return json;
}

std::string terminal_table(const Comparison& comparison) {
    std::string out;
    for (const SceneReport& scene : comparison.scenes) {
        out += format("%s: %llu vertices, %llu triangles, %llu receivers; %s, threads %u; %zu frames x %u\n",
                      printable(scene.name).c_str(), static_cast<unsigned long long>(scene.vertices),
                      static_cast<unsigned long long>(scene.triangles),
                      static_cast<unsigned long long>(scene.receivers), scene.isa.c_str(),
                      comparison.options.threads, scene.times.size(), scene.repeats);
        out += format(
            "  reference: %u rays at %u receivers a frame; noise %s %% (clear %s %%); %llu counted, %llu "
            "clear, %llu see under 1 %%\n",
            scene.reference_rays, scene.reference_receivers, percent(scene.noise.all.mean).c_str(),
            percent(scene.noise.clear.mean).c_str(), static_cast<unsigned long long>(scene.noise.all.count),
            static_cast<unsigned long long>(scene.noise.clear.count),
            static_cast<unsigned long long>(scene.noise.dark));
        out += format("  %-28s %8s %8s %8s | %6s %6s %6s %6s | %6s %6s %6s %6s | %6s %6s | %s\n", "",
                      "us/vtx", "median", "ms/frame", "all %", "p95", "p99", "max", "clear%", "p95", "p99",
                      "max", "AO %", "flick%", "Embree's time at equal error: all, clear");
        for (const Entry& entry : scene.entries) {
            const bool timed = entry.kind != Kind::floor;
            out += format("  %-28s ", entry.name.c_str());
            out += timed ? format("%8.3f %8.3f %8.2f", entry.us.min, entry.us.median, entry.wall_ms.median)
                         : format("%8s %8s %8s", "-", "-", "-");
            for (const bool clear : {false, true}) {
                const ErrorFigures& figures = clear ? entry.clear : entry.all;
                out += " | " + pad(percent(figures, clear ? scene.noise.clear : scene.noise.all), 6);
                for (const double value : {figures.each.p95, figures.each.p99, figures.each.max})
                    out += " " + pad(percent(value), 6);
            }
            const bool noisy = entry.change.mean <= scene.noise.change;
            out +=
                " | " + pad(percent(entry.ambient.mean), 6) + " " +
                pad(entry.change.count == 0 ? "-"
                                            : percent(noisy ? scene.noise.change : entry.change.mean, noisy),
                    6);
            if (entry.kind == Kind::ours) {
                out += " | x " + speedup(entry.peer_all, entry.us) + ", x " +
                       speedup(entry.peer_clear, entry.us);
            }
            if (entry.kind == Kind::peer) out += " | " + entry.setup;
            out += '\n';
        }
        if (!scene.scaling.empty()) {
            out += "  scaling, ms a frame:";
            for (const ScalingPoint& point : scene.scaling)
                out += format(" %s on %u: %.2f;", point.entry.c_str(), point.threads, point.wall_ms.min);
            out += '\n';
        }
        out += format(
            "  memory: meshes %.1f MB, context %.1f MB, peer %.1f MB; peer's BVH built in %.2f ms%s\n",
            static_cast<double>(scene.mesh_bytes) * 1e-6, static_cast<double>(scene.context_bytes) * 1e-6,
            static_cast<double>(scene.peer_bytes) * 1e-6, scene.peer_build_ms,
            scene.peer_refit_ms > 0 ? format(", refitted in %.2f ms", scene.peer_refit_ms).c_str() : "");
        for (const std::string& note : scene.notes)
            out += "  note: " + printable(note) + '\n';
        out += '\n';
    }
    for (const StudyReport& study : comparison.studies)
        out += printable(study.scene) + ", " + study.topic + ":\n" + to_text(study.table) + '\n';
    return out;
}

namespace {

// The median of what could be told.
double middle_of(std::vector<double> values) {
    std::erase_if(values, [](double value) { return !(value > 0) || !std::isfinite(value); });
    return time_of(std::move(values)).median;
}

} // namespace

std::string summary_table(const Comparison& comparison) {
    std::string out =
        format("quality standard, errors in %% of the transfer vector over clear receivers; floor: "
               "exact rays through the same 1024 samples\n%-28s %8s %8s %12s %6s | %7s %7s | %6s %6s "
               "%6s | %6s %5s | %7s | %s\n",
               "", "vertices", "triang.", "errors over", "clear", "us/vtx", "tri/vtx", "mean", "p99", "max",
               "floor", "x", "all", "Embree's time at equal error: clear, all");
    std::vector<double> over_floor, speed, times;
    for (const SceneReport& scene : comparison.scenes) {
        const Entry *entry = find(scene, "standard"), *floor = find(scene, "floor 1024");
        out += format("%-28.28s %8llu %8llu", printable(scene.name).c_str(),
                      static_cast<unsigned long long>(scene.vertices),
                      static_cast<unsigned long long>(scene.triangles));
        if (!entry) {
            out += "  not measured within the limit\n";
            continue;
        }
        const double times_floor =
            floor && floor->clear.each.mean > 1e-5 ? entry->clear.each.mean / floor->clear.each.mean : 0;
        out += format(
            " %12s %5.0f%% |",
            (std::to_string(scene.reference_receivers) + "/" + std::to_string(scene.receivers)).c_str(),
            100 * static_cast<double>(scene.noise.clear.count) /
                std::max<double>(static_cast<double>(scene.noise.all.count), 1));
        out += entry->us.min > 0 ? format(" %7.3f", entry->us.min) : pad("-", 8);
        out += entry->stats ? format(" %7.1f |", static_cast<double>(entry->stats->triangles_rasterized) /
                                                     std::max<double>(entry->stats->receivers_computed, 1))
                            : pad("-", 8) + " |";
        out += " " + pad(percent(entry->clear, scene.noise.clear), 6);
        for (const double value : {entry->clear.each.p99, entry->clear.each.max})
            out += " " + pad(percent(value), 6);
        out += " | " + pad(floor ? percent(floor->clear, scene.noise.clear) : "-", 6) + " " +
               pad(times_floor > 0 ? format("%.2f", times_floor) : "-", 5);
        out += " | " + pad(percent(entry->all, scene.noise.all), 7);
        out += " | x " + pad(speedup(entry->peer_clear, entry->us), 6) + ", x " +
               pad(speedup(entry->peer_all, entry->us), 6) + (scene.complete ? "" : "  (not complete)") +
               "\n";
        over_floor.push_back(times_floor);
        times.push_back(entry->us.min);
        if (entry->us.min > 0) speed.push_back(entry->peer_clear.time / entry->us.min);
    }
    out += format("median of %zu: %.3f us a vertex, %.2f times the floor, x %.1f\n", comparison.scenes.size(),
                  middle_of(times), middle_of(over_floor), middle_of(speed));
    for (const Unmeasured& failure : comparison.failures)
        out += printable(failure.name) + ": not measured: " + printable(failure.reason) + '\n';
    return out + '\n';
}

namespace {

constexpr const char* begin_marker = "<!-- compare:begin -->";
constexpr const char* end_marker = "<!-- compare:end -->";

} // namespace

std::string markdown_studies(const Comparison& comparison) {
    std::string out;
    for (const StudyReport& study : comparison.studies)
        out += "\n**" + printable(study.scene) + ", " + study.topic +
               "** (`nusselt study`, few receivers):\n\n" + to_markdown(study.table);
    return out;
}

// What the study of visible sets says of quality standard; "-" where it was not made.
std::string set_figure(const Comparison& comparison, const std::string& scene, const std::string& column) {
    for (const StudyReport& study : comparison.studies) {
        if (study.scene != scene || study.topic != "pvs") continue;
        const std::vector<std::string>& names = study.table.columns;
        const auto at = std::find(names.begin(), names.end(), column) - names.begin();
        for (const std::vector<std::string>& row : study.table.rows) {
            if (row[0] == "standard") return row[static_cast<size_t>(at)];
        }
    }
    return "-";
}

std::string markdown_tables(const Comparison& comparison) {
    std::string out;
    out += format(
        "Measured on %s (%u threads), %s, revision %s; one entry at a time on %u thread%s, least of %u "
        "rounds; regenerated by `nusselt compare`, not typed.\n\n",
        processor_name().c_str(), std::thread::hardware_concurrency(),
        comparison.scenes.empty() ? "" : comparison.scenes[0].isa.c_str(), source_revision(),
        comparison.options.threads, comparison.options.threads == 1 ? "" : "s", comparison.options.repeats);
    out += "**Run time against error**: processor microseconds a vertex; mean relative L2 error of the "
           "transfer vector "
           "over *clear* receivers and over all (p99 in brackets); how many times longer the peer (Embree, "
           "tuned, BVH refitted or rebuilt, 4x4 packets, cell-integrated weights) takes to the same error on "
           "clear receivers, and over "
           "all.\n\n";
    out += "| scene | quality | us a vertex | ms a frame | error, clear | error, all | Embree takes: clear | "
           "all |\n"
           "|---|---|---|---|---|---|---|---|\n";
    for (const SceneReport& scene : comparison.scenes) {
        for (const Entry& entry : scene.entries) {
            if (entry.kind != Kind::ours) continue;
            out += format("| %s | %s | %.2f | %.2f | %s %% (%s %%) | %s %% (%s %%) | %s x | %s x |\n",
                          printable(scene.name).c_str(), entry.name.c_str(), entry.us.min, entry.wall_ms.min,
                          percent(entry.clear, scene.noise.clear).c_str(),
                          percent(entry.clear.each.p99).c_str(), percent(entry.all, scene.noise.all).c_str(),
                          percent(entry.all.each.p99).c_str(), speedup(entry.peer_clear, entry.us).c_str(),
                          speedup(entry.peer_all, entry.us).c_str());
        }
    }
    const auto row = [&](const char* name, const auto& theirs, const auto& ours) {
        out += std::string("| ") + name;
        for (const SceneReport& scene : comparison.scenes) {
            if (const PaperRow* paper = paper_row(scene.name)) {
                const Entry* entry = find(scene, "paper");
                out += " | " + theirs(*paper) + " | " + (entry && entry->stats ? ours(scene, *entry) : "-");
            }
        }
        out += " |\n";
    };
    std::string head = "|", rule = "|---";
    for (const SceneReport& scene : comparison.scenes) {
        if (!paper_row(scene.name)) continue;
        head += " | " + scene.name + ": paper | ours";
        rule += "|---|---";
    }
    if (rule.size() == 4) return out;
    head += " |\n" + rule + "|\n";

    const auto whole = [](double value) { return format("%.0f", value); };
    const auto tenth = [](double value) { return format("%.1f", value); };
    out += "\n**Table 1 of the paper** (Kautz, Lehtinen, Aila 2004; a 3.06 GHz Pentium 4 Xeon) and quality "
           "`paper`, "
           "which is their method, on one thread:\n\n" +
           head;
    row(
        "vertices", [&](const PaperRow& p) { return whole(p.vertices); },
        [&](const SceneReport& s, const Entry&) { return whole(static_cast<double>(s.vertices)); });
    row(
        "triangles", [&](const PaperRow& p) { return whole(p.triangles); },
        [&](const SceneReport& s, const Entry&) { return whole(static_cast<double>(s.triangles)); });
    row(
        "triangles of the coarse mesh", [&](const PaperRow& p) { return whole(p.coarse_triangles); },
        [&](const SceneReport& s, const Entry&) { return whole(s.coarse_triangles); });
    row(
        "triangles rasterised a vertex", [&](const PaperRow& p) { return tenth(p.rasterized); },
        [&](const SceneReport&, const Entry& e) {
            return tenth(static_cast<double>(e.stats->triangles_rasterized) /
                         std::max<double>(e.stats->receivers_computed, 1));
        });
    row(
        "triangles considered a vertex", [&](const PaperRow&) { return std::string("-"); },
        [&](const SceneReport&, const Entry& e) {
            return tenth(static_cast<double>(e.stats->triangles_considered) /
                         std::max<double>(e.stats->receivers_computed, 1));
        });
    const auto given = [&](double value) { return value > 0 ? tenth(value) : std::string("-"); };
    const auto takes_none = [](const SceneReport&, const Entry&) {
        return std::string("-");
    }; // quality paper
    row(
        "triangles rasterised with their PVS", [&](const PaperRow& p) { return given(p.rasterized_pvs); },
        takes_none);
    row(
        "frames a second", [&](const PaperRow& p) { return tenth(p.fps); },
        [&](const SceneReport&, const Entry& e) {
            return whole(e.wall_ms.min > 0 ? 1e3 / e.wall_ms.min : 0);
        });
    row(
        "frames a second with their PVS", [&](const PaperRow& p) { return given(p.fps_pvs); }, takes_none);
    // Quality paper takes no sets; ours are of levels of detail.
    const auto none = [](const PaperRow&) { return std::string("-"); };
    const auto with_sets = [&](const char* name, const char* column) {
        row(name, none,
            [&](const SceneReport& s, const Entry&) { return set_figure(comparison, s.name, column); });
    };
    with_sets("`standard`: triangles looked at", "looked at");
    with_sets("`standard`: looked at with a visible set", "looked at with a set");
    with_sets("`standard`: frames a second", "frames a second");
    with_sets("`standard`: frames a second with a visible set", "frames with a set");
    row(
        "mean L2 error, %", [&](const PaperRow& p) { return percent(p.error); },
        [&](const SceneReport&, const Entry& e) { return percent(e.all.each.mean); });

    out += "\n**Table 2 of the paper**: where the time goes, %, quality `paper`:\n\n" + head;
    row(
        "rasterization", [&](const PaperRow& p) { return tenth(100 * p.shares[0]); },
        [&](const SceneReport&, const Entry& e) { return tenth(100 * shares_of(*e.stats).raster); });
    row(
        "integration", [&](const PaperRow& p) { return tenth(100 * p.shares[1]); },
        [&](const SceneReport&, const Entry& e) { return tenth(100 * shares_of(*e.stats).integrate); });
    row(
        "transform, with culling", [&](const PaperRow& p) { return tenth(100 * p.shares[2]); },
        [&](const SceneReport&, const Entry& e) {
            return tenth(100 * (shares_of(*e.stats).transform + shares_of(*e.stats).cull));
        });
    row(
        "other", [&](const PaperRow& p) { return tenth(100 * p.shares[3]); },
        [&](const SceneReport&, const Entry& e) {
            return tenth(100 * (shares_of(*e.stats).rotate + shares_of(*e.stats).refit));
        });
    return out;
}

std::string with_tables(const std::string& text, const std::string& tables, const std::string& path) {
    const size_t begin = text.find(begin_marker);
    const size_t end = text.find(end_marker);
    if (begin == std::string::npos || end == std::string::npos || end < begin) {
        throw Failure(path, std::string("has no lines '") + begin_marker + "' and '" + end_marker +
                                "'; add them where the tables belong");
    }
    return text.substr(0, begin + std::string_view(begin_marker).size()) + "\n" + tables + text.substr(end);
}

} // namespace nusselt::tools
