#include "tools/commands/commands.h"
#include "tools/commands/pvs.h"
#include "tools/commands/study.h"

#include "tools/report/failure.h"
#include "tools/report/stop.h"

#include <CLI/CLI.hpp>

#include <cstdio>
#include <cstdlib>
#include <new>
#include <optional>

namespace nusselt::tools {

namespace {

constexpr uint32_t most_frames = 100000;
constexpr uint32_t largest_side = 8192;

void tell(const Failure& failure) {
    std::fprintf(stderr, "%s\n", failure_line(failure.subject, failure.what()).c_str());
}

void at_least_one(const char* option, uint32_t value, uint32_t most) {
    if (value >= 1 && value <= most) return;
    throw Failure(option, "must lie between 1 and " + std::to_string(most) + "; choose such a number",
                  exit_usage);
}

void parse_size(const std::string& text, uint32_t& width, uint32_t& height) {
    int used = 0;
    unsigned w = 0, h = 0;
    const bool fits = text.size() <= 11 && text.find_first_not_of("0123456789x") == std::string::npos &&
                      std::sscanf(text.c_str(), "%ux%u%n", &w, &h, &used) == 2 &&
                      static_cast<size_t>(used) == text.size();
    if (!fits || w < 1 || h < 1 || w > largest_side || h > largest_side) {
        throw Failure("--size",
                      "'" + text + "' is no WIDTHxHEIGHT of 1 to 8192 pixels; write it like 960x720",
                      exit_usage);
    }
    width = w;
    height = h;
}

void parse_window(const std::string& text, RenderOptions& render) {
    const size_t colon = text.find(':');
    const std::string name = text.substr(0, colon);
    char* end = nullptr;
    const std::string width = colon == std::string::npos ? "" : text.substr(colon + 1);
    render.window_width = std::strtof(width.c_str(), &end);
    if ((name != "hann" && name != "lanczos") || width.empty() || *end || !(render.window_width > 0)) {
        throw Failure("--window",
                      "'" + text + "' is no window; write hann:WIDTH or lanczos:WIDTH, like hann:6",
                      exit_usage);
    }
    render.window = name == "hann" ? ShWindow::hann : ShWindow::lanczos;
}

Falloff parse_falloff(const std::string& text) {
    Falloff falloff;
    int used = 0;
    const bool two = std::sscanf(text.c_str(), "%f:%f%n", &falloff.from, &falloff.to, &used) == 2 &&
                     static_cast<size_t>(used) == text.size();
    if (!two || !(falloff.from >= 0 && falloff.to > 0 && falloff.from <= falloff.to && falloff.to < 1e30f)) {
        throw Failure("--falloff", "'" + text + "' is no pair of distances; write FROM:TO like 0.05:0.4",
                      exit_usage);
    }
    return falloff;
}

Show parse_show(const std::string& name) {
    if (name == "radiance") return Show::radiance;
    if (name == "ambient-occlusion") return Show::ambient_occlusion;
    if (name == "bent-normal") return Show::bent_normal;
    if (name == "visible-set") return Show::visible_set;
    throw Failure("--show",
                  "there is no '" + name +
                      "'; choose one of radiance, ambient-occlusion, bent-normal, visible-set",
                  exit_usage);
}

Shadows parse_shadows(const std::string& name) {
    if (name == "off") return Shadows::off;
    if (name == "on") return Shadows::on;
    if (name == "traced") return Shadows::traced;
    throw Failure("--shadows", "there is no '" + name + "'; choose one of off, on, traced", exit_usage);
}

struct CompareWords {
    std::optional<uint32_t> frames, repeats, receivers;
    std::string isa = "best";
};

CLI::App* add_compare(CLI::App& app, CompareOptions& compare, CompareWords& words) {
    CLI::App* command = app.add_subcommand(
        "compare",
        "run time against error: every quality and Embree at many ray counts against one reference");
    CLI::Option* model =
        command
            ->add_option("model", compare.models,
                         "glTF, GLB, OBJ or PLY files, or directories that are looked through for them")
            ->type_name("MODEL");
    command
        ->add_option("--scene", compare.scene,
                     "built-in scene instead of a model: cloth, fight, chess, hand, all")
        ->type_name("NAME")
        ->excludes(model)
        ->capture_default_str();
    command->add_option("--out", compare.out, "directory for index.html, report.json, tables.md and pictures")
        ->type_name("DIR")
        ->required();
    command
        ->add_option("--clip", compare.clip,
                     "animation of the model by name or number, of a single one; default: the first")
        ->type_name("NAME|N");
    command->add_flag("--quick", compare.quick,
                      "one moment, few receivers with a reference, two timed rounds, at most 1024 rays");
    command->add_option("--frames", words.frames, "moments of the animation; default: 3")->type_name("N");
    command->add_option("--repeats", words.repeats, "timed rounds over all entries; default: 3")
        ->type_name("N");
    command
        ->add_option("--threads", compare.measure.threads,
                     "threads of every entry; with one, each entry's time is that thread's own clock")
        ->type_name("N")
        ->capture_default_str();
    command
        ->add_option("--isa", words.isa, "instruction set of our entries: scalar, sse4, avx2, avx512, best")
        ->type_name("NAME")
        ->capture_default_str();
    command
        ->add_option(
            "--limit", compare.measure.limit_seconds,
            "seconds that each model may take: the reference and Embree's times are then taken on as "
            "many receivers as fit, and scaling is left out; default: no limit")
        ->type_name("S");
    command->add_flag("--naive", compare.measure.naive,
                      "adds Embree with one ray at a time, for information");
    command
        ->add_option("--reference-rays", compare.measure.reference_rays, "rays a receiver of the reference")
        ->type_name("N")
        ->capture_default_str();
    command
        ->add_option(
            "--receivers", words.receivers,
            "receivers a frame with a reference, evenly chosen; default: 20000. Times are always over all")
        ->type_name("N");
    command
        ->add_option(
            "--env", compare.environments,
            "further environment for the radiance error, a latitude-longitude .hdr or .exr image; may be "
            "given several times")
        ->type_name("FILE")
        ->allow_extra_args(false);
    command
        ->add_option("--study", compare.studies,
                     "topics of `nusselt study` that each scene gets a table of: glossy, direct, pvs, "
                     "objects, falloff, static, sides, outputs; default: "
                     "all with --scene all, objects on its fight alone, but none with --quick")
        ->type_name("TOPIC")
        ->check(
            CLI::IsMember({"glossy", "direct", "pvs", "objects", "falloff", "static", "sides", "outputs"}));
    command
        ->add_option(
            "--readme", compare.readme,
            "file whose tables between the lines <!-- compare:begin --> and <!-- compare:end --> are "
            "written anew")
        ->type_name("FILE");
    return command;
}

void finish_compare(CompareOptions& compare, const CompareWords& words) {
    MeasureOptions& measure = compare.measure;
    if (compare.quick) {
        measure.frames = 1;
        measure.repeats = 2;
        measure.most_receivers = 400;
        measure.most_peer_rays = 1024;
    }
    measure.frames = words.frames.value_or(measure.frames);
    measure.repeats = words.repeats.value_or(measure.repeats);
    measure.most_receivers = words.receivers.value_or(measure.most_receivers);
    at_least_one("--frames", measure.frames, most_frames);
    at_least_one("--repeats", measure.repeats, most_frames);
    at_least_one("--receivers", measure.most_receivers, 1u << 27);
    at_least_one("--threads", measure.threads, 1024);
    at_least_one("--reference-rays", measure.reference_rays, 1u << 20);
    if (!(measure.limit_seconds >= 0 && measure.limit_seconds <= 1e6))
        throw Failure("--limit", "must lie between 0 (no limit) and a million seconds", exit_usage);
    measure.isa = parse_isa(words.isa);
    if (measure.isa == Isa::best) check_isa_variable();
}

// What the options say as text, before it is understood.
struct Words {
    std::string quality = "standard", isa = "best", shadows = "on", size = "960x720", brdf = "lambert";
    std::string show = "radiance", window, light = "sh", falloff, two_sided = "off";
    std::vector<std::string> outputs;
    uint32_t threads = 0;
};

void add_engine(CLI::App& command, Words& words) {
    command
        .add_option(
            "--quality", words.quality,
            "paper (the method as published), draft (fewest triangles), standard, fine (4096-bit masks)")
        ->type_name("NAME")
        ->capture_default_str();
    command
        .add_option("--threads", words.threads,
                    "threads to compute on; 1: serial, no thread is made; default: all")
        ->type_name("N");
    command
        .add_option("--isa", words.isa, "instruction set: scalar, sse4, avx2, avx512, best; also NUSSELT_ISA")
        ->type_name("NAME")
        ->capture_default_str();
}

EngineOptions parse_engine(const CLI::App& command, const Words& words) {
    EngineOptions engine;
    if (command.count("--threads") > 0) at_least_one("--threads", words.threads, 1024);
    engine.threads = words.threads;
    engine.isa = parse_isa(words.isa);
    if (engine.isa == Isa::best) check_isa_variable();
    return engine;
}

void add_moment(CLI::App& command, std::string& clip, std::optional<double>& time) {
    command
        .add_option("--clip", clip,
                    "animation by name or number (nusselt info lists them); default: the first, or "
                    "with no time given the model as it stands")
        ->type_name("NAME|N");
    command.add_option("--time", time, "moment of the clip in seconds")->type_name("S");
}

void parse_and_run(int argc, const char* const* argv) {
    CLI::App app("Soft self-shadows of deforming meshes: transfer vectors and pictures on the CPU.",
                 "nusselt");
    app.set_help_flag("--help,-h", "print this help and exit");
    app.set_help_all_flag("--help-all", "print the help of all commands and exit");
    app.set_version_flag("--version", configuration(), "print the version and how it was built, and exit");
    app.require_subcommand(1);
    app.footer("Exit code: 0 success, 1 failure, 2 usage. Errors are one line on stderr. A failed run leaves "
               "no output.");

    DemoOptions demo;
    Words demo_words;
    CLI::App* demo_command =
        app.add_subcommand("demo", "built-in scenes under a sky: pictures unshadowed, ours and "
                                   "ray-traced, times and errors, as one page");
    demo_command->add_option("--out", demo.out, "directory for index.html, frames and table.json")
        ->type_name("DIR")
        ->required();
    demo_command->add_flag("--quick", demo.quick, "few small frames with few rays");
    demo_command->add_option("--threads", demo_words.threads, "threads for our frames; default: all")
        ->type_name("N");
    demo_command->add_option("--isa", demo_words.isa, "instruction set")
        ->type_name("NAME")
        ->capture_default_str();

    InfoOptions info;
    CLI::App* info_command =
        app.add_subcommand("info", "what a model holds: meshes, clips, closed or open, levels, warnings");
    info_command->add_option("model", info.model, "glTF, GLB, OBJ or PLY file")
        ->type_name("MODEL")
        ->required();
    info_command->add_flag("--json", info.json, "the same and more as JSON");

    TransferOptions transfer;
    Words transfer_words;
    CLI::App* transfer_command = app.add_subcommand(
        "transfer", "transfer vectors and masks of a posed model as NumPy arrays (.npy), and stats.json");
    transfer_command->add_option("model", transfer.model, "glTF, GLB, OBJ or PLY file")
        ->type_name("MODEL")
        ->required();
    transfer_command->add_option("--out", transfer.out, "directory for the arrays")
        ->type_name("DIR")
        ->required();
    add_moment(*transfer_command, transfer.clip, transfer.time);
    add_engine(*transfer_command, transfer_words);
    transfer_command
        ->add_option("--repeat", transfer.repeat, "frames to time; several are preceded by one untimed")
        ->type_name("N")
        ->capture_default_str();

    transfer_command
        ->add_option("--output", transfer_words.outputs,
                     "further array KIND[:FORMAT[:BANDS]] as nusselt/output.h has them: transfer, "
                     "ambient_occlusion, bent_normal; float32, float16, packed8; 1 to 5 bands of a transfer. "
                     "May be given several times")
        ->type_name("STREAM")
        ->allow_extra_args(false);
    transfer_command
        ->add_option(
            "--two-sided", transfer_words.two_sided,
            "arrays NAME_back.npy too, for the hemispheres behind the vertices: off, model (where the "
            "file's materials are doubleSided, zeros elsewhere), all")
        ->type_name("WHICH")
        ->capture_default_str();

    transfer_command
        ->add_option(
            "--pvs", transfer.visible_set,
            "file of `nusselt pvs` with the blockers to look at; made of this model, clip and quality")
        ->type_name("FILE");

    PvsOptions pvs;
    Words pvs_words;
    pvs_words.two_sided = "model";
    CLI::App* pvs_command = app.add_subcommand(
        "pvs", "potentially visible sets of a clip: the blockers that ever matter, as a file for its frames");
    pvs_command->add_option("model", pvs.model, "glTF or GLB file with an animation")
        ->type_name("MODEL")
        ->required();
    pvs_command->add_option("--out", pvs.out, "the file")->type_name("FILE")->required();
    pvs_command->add_option("--clip", pvs.clip, "animation by name or number; default: the first")
        ->type_name("NAME|N");
    pvs_command
        ->add_option("--frames", pvs.frames, "moments of the clip that are recorded, its ends included")
        ->type_name("N")
        ->capture_default_str();
    pvs_command
        ->add_option("--segments", pvs.segments,
                     "equal parts of the clip with a set each: smaller sets, a larger file")
        ->type_name("N")
        ->capture_default_str();
    pvs_command
        ->add_option("--two-sided", pvs_words.two_sided,
                     "record the backs of meshes too: off, model (of those that have a doubleSided "
                     "material), all")
        ->type_name("WHICH")
        ->capture_default_str();
    pvs_command->add_flag("--watertight", pvs.watertight, "record watertight frames, for such frames");
    add_engine(*pvs_command, pvs_words);

    RenderOptions render;
    Words render_words;
    render_words.two_sided = "model";
    CLI::App* render_command =
        app.add_subcommand("render", "pictures of a model with soft self-shadows (PNG)");
    render_command->add_option("model", render.model, "glTF, GLB, OBJ or PLY file")
        ->type_name("MODEL")
        ->required();
    render_command->add_option("--out", render.out, "directory for frame_0000.png and on")
        ->type_name("DIR")
        ->required();
    render_command
        ->add_option("--env", render.environment,
                     "environment, a latitude-longitude .hdr or .exr image, or 'sky' for the built-in one")
        ->type_name("FILE|sky")
        ->capture_default_str();
    add_moment(*render_command, render.clip, render.time);
    CLI::Option* frames =
        render_command->add_option("--frames", render.frames, "pictures from the clip's start on")
            ->type_name("N");
    frames->excludes("--time");
    render_command->add_option("--fps", render.fps, "pictures a second of the clip, with --frames")
        ->type_name("F")
        ->needs(frames)
        ->capture_default_str();
    render_command
        ->add_option("--shadows", render_words.shadows,
                     "off, on, or traced: from ray-traced transfer vectors")
        ->type_name("MODE")
        ->capture_default_str();
    render_command->add_option("--rays", render.rays, "rays a vertex with --shadows traced")
        ->type_name("N")
        ->capture_default_str();
    render_command
        ->add_option(
            "--show", render_words.show,
            "radiance; ambient-occlusion or bent-normal, as the library writes them; visible-set: how "
            "much of the blockers the set of --pvs has each vertex look at, from none (blue) to the "
            "most (orange)")
        ->type_name("WHAT")
        ->capture_default_str();
    render_command
        ->add_option(
            "--brdf", render_words.brdf,
            "reflection of all meshes: lambert, phong:EXPONENT[:SPECULAR], ggx:ROUGHNESS[:METALLIC], or "
            "model: a glTF file's metallic-roughness factors")
        ->type_name("NAME")
        ->capture_default_str();
    render_command
        ->add_option("--light", render_words.light,
                     "sh: 25 terms, as an engine would; direct: straight from the masks and the environment")
        ->type_name("HOW")
        ->capture_default_str();
    render_command
        ->add_option("--falloff", render_words.falloff,
                     "occlusion fades from one distance to another, in the model's unit; not physical")
        ->type_name("FROM:TO");
    render_command
        ->add_option("--with", render.further.paths,
                     "further model in the picture, an object of its own: it shadows the others as a coarser "
                     "one. Its first clip plays where one does. May be given several times")
        ->type_name("MODEL")
        ->allow_extra_args(false);
    render_command
        ->add_option("--at", render.further.places,
                     "what a model of --with is moved by, once for each in turn; default: a row along x")
        ->type_name("X:Y:Z")
        ->allow_extra_args(false);
    render_command->add_flag("--ground", render.roles.ground,
                             "a plane below the model that takes its shadows and hides nothing");
    render_command
        ->add_option("--receive-only", render.roles.receive_only,
                     "mesh that takes shadows and hides nothing, not even of itself. May be given several "
                     "times")
        ->type_name("NAME|N")
        ->allow_extra_args(false);
    render_command
        ->add_option("--block-only", render.roles.block_only,
                     "mesh that hides the light and is not drawn. May be given several times")
        ->type_name("NAME|N")
        ->allow_extra_args(false);
    render_command->add_flag("--keep", render.keep,
                             "keep what did not move since the frame before, for surroundings that are "
                             "static: the same pictures, with less work");
    render_command->add_flag("--watertight", render.watertight,
                             "no light inside what is closed: the last open samples of a nearly closed mask "
                             "are asked of the triangles themselves");
    render_command
        ->add_option(
            "--pvs", render.visible_set,
            "file of `nusselt pvs` with the blockers to look at; made of this model, clip and quality")
        ->type_name("FILE");
    render_command
        ->add_option("--two-sided", render_words.two_sided,
                     "light the backs of what is seen from behind: off (they look like the fronts), model "
                     "(where the file's materials are doubleSided), all")
        ->type_name("WHICH")
        ->capture_default_str();
    render_command
        ->add_option(
            "--window", render_words.window,
            "damps the light's high bands: hann:WIDTH or lanczos:WIDTH, in bands; 5 is strong, 10 mild")
        ->type_name("NAME:WIDTH");
    render_command->add_option("--size", render_words.size, "of the pictures, in pixels")
        ->type_name("WxH")
        ->capture_default_str();
    add_engine(*render_command, render_words);

    StudyOptions study;
    Words study_words;
    study_words.threads = 1;
    CLI::App* study_command = app.add_subcommand(
        "study", "what a further part of the method costs and how wrong it is: a table and JSON");
    study_command
        ->add_option("topic", study.topic, "glossy, direct, pvs, objects, falloff, static, sides, outputs")
        ->type_name("TOPIC")
        ->required();
    CLI::Option* study_model =
        study_command->add_option("--model", study.model, "glTF, GLB, OBJ or PLY file")->type_name("MODEL");
    study_command
        ->add_option("--scene", study.scene, "built-in scene instead of a model: cloth, fight, chess, hand")
        ->type_name("NAME")
        ->excludes(study_model)
        ->capture_default_str();
    study_command->add_option("--out", study.out, "directory for TOPIC.json and TOPIC.txt")
        ->type_name("DIR")
        ->required();
    study_command->add_option("--clip", study.clip, "animation of the model; default: the first")
        ->type_name("NAME|N");
    study_command->add_flag("--quick", study.quick, "few receivers, rays and rounds");
    add_engine(*study_command, study_words);

    CompareOptions compare;
    CompareWords compare_words;
    CLI::App* compare_command = add_compare(app, compare, compare_words);
    for (int k = 1; k < argc; ++k)
        compare.command.append(k > 1 ? " " : "").append(argv[k]);

    if (argc > 1 && argv[1][0] != '-') {
        bool known = false;
        std::string list;
        for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
            known = known || command->get_name() == argv[1];
            list.append(list.empty() ? "" : ", ").append(command->get_name());
        }
        if (!known) {
            throw Failure("usage",
                          std::string("there is no command '") + argv[1] + "'; choose one of " + list,
                          exit_usage);
        }
    }
    try {
        app.parse(argc, argv);
    } catch (const CLI::Success& done) {
        app.exit(done);
        return;
    } catch (const CLI::ParseError& error) {
        std::string command;
        for (const CLI::App* parsed : app.get_subcommands())
            command = parsed->get_name() + " ";
        throw Failure("usage", std::string(error.what()) + "; see nusselt " + command + "--help", exit_usage);
    }

    // `compare` tells what it has so far.
    std::optional<PromptStop> prompt;
    if (!compare_command->parsed()) prompt.emplace();
    if (demo_command->parsed()) {
        demo.engine = parse_engine(*demo_command, demo_words);
        run_demo(demo);
    } else if (info_command->parsed()) {
        run_info(info);
    } else if (transfer_command->parsed()) {
        transfer.engine = parse_engine(*transfer_command, transfer_words);
        transfer.quality = parse_quality(transfer_words.quality);
        at_least_one("--repeat", transfer.repeat, most_frames);
        for (const std::string& text : transfer_words.outputs)
            transfer.streams.push_back(parse_stream(text, "--output"));
        transfer.two_sided = parse_two_sided(transfer_words.two_sided);
        run_transfer(transfer);
    } else if (pvs_command->parsed()) {
        pvs.engine = parse_engine(*pvs_command, pvs_words);
        pvs.quality = parse_quality(pvs_words.quality);
        if (pvs.quality == Quality::paper)
            throw Failure("--quality",
                          "paper has one coarse mesh and no sets; choose draft, standard or fine",
                          exit_usage);
        at_least_one("--frames", pvs.frames, most_frames);
        at_least_one("--segments", pvs.segments, most_segments);
        pvs.two_sided = parse_two_sided(pvs_words.two_sided);
        run_pvs(pvs);
    } else if (study_command->parsed()) {
        study.engine = parse_engine(*study_command, study_words);
        study.quality = parse_quality(study_words.quality);
        run_study(study);
    } else if (compare_command->parsed()) {
        finish_compare(compare, compare_words);
        run_compare(compare);
    } else {
        render.engine = parse_engine(*render_command, render_words);
        render.quality = parse_quality(render_words.quality);
        render.shadows = parse_shadows(render_words.shadows);
        render.show = parse_show(render_words.show);
        if (render.show != Show::radiance && render.shadows != Shadows::on) {
            throw Failure("--show", "what is not radiance comes from the library; leave --shadows out",
                          exit_usage);
        }
        if (render.show == Show::visible_set && render.visible_set.empty())
            throw Failure("--show", "visible-set is of a set; give one with --pvs", exit_usage);
        parse_size(render_words.size, render.width, render.height);
        render.two_sided = parse_two_sided(render_words.two_sided);
        at_least_one("--rays", render.rays, 1u << 20);
        if (render.frames) at_least_one("--frames", *render.frames, most_frames);
        if (!(render.fps > 0 && render.fps <= 1e6)) {
            throw Failure("--fps", "must be a positive number; 30 is usual", exit_usage);
        }
        render.reflectance = parse_reflectance(render_words.brdf, "--brdf");
        render.direct = render_words.light == "direct";
        if (!render.direct && render_words.light != "sh") {
            throw Failure("--light", "there is no '" + render_words.light + "'; choose sh or direct",
                          exit_usage);
        }
        if (render.direct && (render.shadows != Shadows::on || !render_words.window.empty())) {
            throw Failure("--light",
                          "direct light has shadows from the library and no bands; leave --shadows and "
                          "--window out",
                          exit_usage);
        }
        if (render.watertight && (render.shadows != Shadows::on || render.quality == Quality::paper ||
                                  !render_words.falloff.empty())) {
            throw Failure("--watertight",
                          "only masks of the library are made watertight, and not with quality paper or "
                          "--falloff; leave --shadows and --falloff out and use another quality",
                          exit_usage);
        }
        if (!render_words.falloff.empty()) {
            render.falloff = parse_falloff(render_words.falloff);
            const bool plain = render.reflectance.kind == Reflectance::Kind::lambert && !render.direct;
            if (!plain || render.shadows != Shadows::on || render.quality == Quality::paper) {
                throw Failure("--falloff",
                              "only transfer vectors of the library know it, and not quality paper; leave "
                              "--brdf, --light and --shadows out",
                              exit_usage);
            }
        }
        const bool from_masks = render.reflectance.kind != Reflectance::Kind::lambert || render.direct;
        if (render.keep && (render.shadows != Shadows::on || from_masks || !render_words.falloff.empty() ||
                            !render.visible_set.empty())) {
            throw Failure("--keep",
                          "transfer vectors of the library are kept, without falloff and visible set; leave "
                          "--shadows, --brdf, --light, --falloff and --pvs out",
                          exit_usage);
        }
        if (!render.visible_set.empty() && (render.roles.ground || !render.roles.receive_only.empty())) {
            throw Failure("--pvs", "a set is of meshes that all block; leave --ground and --receive-only out",
                          exit_usage);
        }
        check_places(render.further);
        if (!render.further.paths.empty() && (!render.visible_set.empty() || render.keep))
            throw Failure(
                render.keep ? "--keep" : "--pvs",
                "is of one model: several see what is far of one another otherwise; leave --with out",
                exit_usage);
        if (!render_words.window.empty()) parse_window(render_words.window, render);
        run_render(render);
    }
}

} // namespace

int run_program(int argc, const char* const* argv) {
    watch_signals();
    try {
        parse_and_run(argc, argv);
        if (std::fflush(stdout) != 0 || std::ferror(stdout)) {
            throw Failure("standard output", "cannot be written; check where it goes");
        }
        return 0;
    } catch (const Failure& failure) {
        tell(failure);
        return failure.exit_code;
    } catch (const std::bad_alloc&) {
        tell(Failure("memory",
                     "there is not enough of it for this; close other programs or use a smaller model"));
    } catch (const std::exception& error) {
        tell(Failure("internal error", std::string(error.what()) + "; please report it"));
    }
    return exit_failure;
}

} // namespace nusselt::tools
