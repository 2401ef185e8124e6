#include "tools/commands/choice.h"
#include "tools/commands/commands.h"
#include "tools/commands/study.h"
#include "tools/compare/clock.h"
#include "tools/compare/report.h"
#include "tools/report/failure.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>

namespace nusselt::tools {

namespace {

namespace fs = std::filesystem;

struct Source {
    std::string label;
    std::string path; // empty: built in
};

bool is_model(const fs::path& path) {
    std::string ending = path.extension().string();
    for (char& c : ending)
        c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return ending == ".gltf" || ending == ".glb" || ending == ".obj" || ending == ".ply";
}

std::vector<std::string> model_files(const std::vector<std::string>& given) {
    std::vector<std::string> files;
    for (const std::string& path : given) {
        std::error_code error;
        if (!fs::is_directory(path, error)) {
            files.push_back(path);
            continue;
        }
        std::vector<std::string> found;
        fs::recursive_directory_iterator at(path, error), end;
        for (; !error && at != end; at.increment(error))
            if (is_model(at->path()) && at->is_regular_file()) found.push_back(at->path().string());
        if (error) throw Failure(path, "can't be looked through: " + error.message() + "; check its rights");
        if (found.empty())
            throw Failure(path, "holds no .gltf, .glb, .obj or .ply file; give another directory");
        std::sort(found.begin(), found.end());
        files.insert(files.end(), found.begin(), found.end());
    }
    return files;
}

std::vector<Source> choose_sources(const CompareOptions& options) {
    std::vector<Source> subjects;
    if (!options.models.empty()) {
        for (const std::string& file : model_files(options.models)) {
            // Files of one name are told apart by their directories'.
            std::string label = fs::path(file).filename().string();
            for (const Source& other : subjects)
                if (other.label == label) label = (fs::path(file).parent_path().filename() / label).string();
            subjects.push_back({label, file});
        }
        if (subjects.size() > 1 && !options.clip.empty())
            throw Failure("--clip", "names an animation of one model; give one, or leave it out", exit_usage);
        return subjects;
    }
    std::string list = "all";
    for (const std::string& name : scenes::builtin_names()) {
        list += ", " + name;
        if (options.scene == "all" || options.scene == name) subjects.push_back({name, {}});
    }
    if (subjects.empty()) {
        throw Failure("--scene", "there is no scene '" + options.scene + "'; choose one of " + list,
                      exit_usage);
    }
    return subjects;
}

scenes::Scene load_source(const Source& source, const std::string& clip) {
    scenes::Scene scene =
        source.path.empty() ? scenes::builtin(source.label) : choose(source.path, clip, true).scene;
    scene.name = source.label;
    return scene;
}

Light environment_light(const std::string& name, const Image& image) {
    Light light{name, {}};
    const std::vector<float> terms = project_environment(image, name);
    std::copy(terms.begin(), terms.end(), light.terms.begin());
    return light;
}

std::string read_text(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw Failure(path, "cannot be read; give the README that holds the markers");
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

// Glossy, direct light, visible sets, falloff, what stands still, both sides and outputs on every built-in
// scene, the crowd on the boxers; elsewhere what is asked for.
std::vector<std::string> studies_of(const CompareOptions& options, const std::string& label) {
    if (!options.studies.empty()) return options.studies;
    if (!options.models.empty() || options.scene != "all" || options.quick) return {};
    std::vector<std::string> topics{"glossy", "direct", "pvs", "falloff", "static", "sides", "outputs"};
    if (label == "fight") topics.emplace_back("objects");
    return topics;
}

void study_scene(const CompareOptions& options, const std::string& label, const scenes::Scene& scene,
                 const std::function<void(double, const char*)>& progress,
                 std::vector<StudyReport>& reports) {
    const std::vector<std::string> topics = studies_of(options, label);
    Subject subject{label, scene, {}};
    subject.scene.pose(0.3 * subject.scene.duration, subject.pose);
    StudyOptions study;
    study.quick = true;
    study.pictures = false;
    study.most_objects = 16;
    study.engine.threads = 1;
    study.engine.isa = options.measure.isa;
    for (size_t k = 0; k < topics.size(); ++k) {
        study.progress = [&](double done) {
            progress((static_cast<double>(k) + done) / static_cast<double>(topics.size()), topics[k].c_str());
        };
        reports.push_back({label, topics[k], run_topic(topics[k], subject, study).table});
    }
}

} // namespace

void run_compare(const CompareOptions& options) {
    const double start = wall_ms();
    const std::vector<Source> subjects = choose_sources(options);
    OutputDirectory out(options.out);
    // Until rays are traced, which look at the signal themselves, there is nothing to tell.
    std::optional<PromptStop> prompt(std::in_place);
    const std::string readme = options.readme.empty() ? std::string() : read_text(options.readme);
    if (!readme.empty()) (void)with_tables(readme, "", options.readme);

    std::vector<Light> lights{environment_light("sky", sky(256, 128, 0)), sun_light(), gradient_light()};
    for (const std::string& path : options.environments) {
        const size_t slash = path.find_last_of('/');
        lights.push_back(environment_light(path.substr(slash == std::string::npos ? 0 : slash + 1),
                                           load_environment(path)));
    }

    throw_if_interrupted();
    Comparison comparison;
    comparison.options = options.measure;
    comparison.command = options.command;
    {
        Progress progress("compare");
        const bool sized = options.models.empty() && options.scene == "all";
        const double share = 1 / static_cast<double>(subjects.size() + sized);
        for (size_t k = 0; k < subjects.size() && !interrupted(); ++k) {
            const Source& subject = subjects[k];
            progress.show(share * static_cast<double>(k), subject.label);
            try {
                const scenes::Scene scene = load_source(subject, options.clip);
                const auto show = [&](double done, const std::string& what) {
                    prompt.reset();
                    progress.show(share * (static_cast<double>(k) + done), subject.label + ", " + what);
                };
                comparison.scenes.push_back(measure_scene(scene, options.measure, lights, show));
                study_scene(options, subject.label, scene, show, comparison.studies);
            } catch (const Failure& failure) {
                // What was measured before, and what can be measured after, is told all the same.
                if (comparison.scenes.empty() && (subjects.size() == 1 || interrupted())) throw;
                if (!interrupted()) comparison.failures.push_back({subject.label, failure.what()});
            }
        }
        if (comparison.scenes.empty())
            throw Failure("compare", "none of the models could be measured; the first: " +
                                         comparison.failures[0].name + ": " + comparison.failures[0].reason);
        if (sized && !interrupted()) {
            comparison.sizes =
                measure_sizes(options.measure, options.quick, [&](double done, const char* what) {
                    progress.show(share * (static_cast<double>(subjects.size()) + done), what);
                });
        }
    }
    comparison.complete = !interrupted();
    comparison.seconds = (wall_ms() - start) / 1e3;

    out.add("report.json", report_json(comparison).dump(1) + "\n");
    out.add("index.html", report_page(comparison));
    out.add("tables.md", markdown_tables(comparison) + markdown_studies(comparison));
    for (const SceneReport& scene : comparison.scenes)
        for (const Shot& shot : scene.shots)
            out.add("pictures/" + shot.name + ".png", encode_png(shot.picture));
    out.commit();
    if (!readme.empty()) {
        if (comparison.complete) {
            write_file(options.readme, with_tables(readme, markdown_tables(comparison), options.readme));
        } else {
            std::fprintf(stderr, "%s\n",
                         failure_line(options.readme, "is left as it was: the run was cut short").c_str());
        }
    }
    constexpr size_t most_tables = 4;
    if (comparison.scenes.size() <= most_tables) std::fputs(terminal_table(comparison).c_str(), stdout);
    if (subjects.size() > 1) std::fputs(summary_table(comparison).c_str(), stdout);
    std::printf("%s%.0f s on %s; revision %s\n%s/index.html\n", comparison.complete ? "" : "cut short; ",
                comparison.seconds, processor_name().c_str(), source_revision(),
                printable(out.path()).c_str());
    if (!comparison.failures.empty())
        throw Failure("compare", std::to_string(comparison.failures.size()) + " of " +
                                     std::to_string(subjects.size()) +
                                     " models could not be measured; the summary says why");
}

} // namespace nusselt::tools
