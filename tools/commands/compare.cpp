#include "tools/commands/choice.h"
#include "tools/commands/commands.h"
#include "tools/compare/clock.h"
#include "tools/compare/report.h"
#include "tools/report/failure.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>

namespace nusselt::tools {

namespace {

struct Subject {
    std::string label;
    scenes::Scene scene;
};

std::vector<Subject> choose_subjects(const CompareOptions& options) {
    std::vector<Subject> subjects;
    if (!options.model.empty()) {
        Choice choice = choose(options.model, options.clip, true);
        subjects.push_back({choice.scene.name, std::move(choice.scene)});
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

} // namespace

void run_compare(const CompareOptions& options) {
    const double start = wall_ms();
    std::vector<Subject> subjects = choose_subjects(options);
    OutputDirectory out(options.out);
    const std::string readme = options.readme.empty() ? std::string() : read_text(options.readme);
    if (!readme.empty()) (void)with_tables(readme, "", options.readme);

    std::vector<Light> lights{environment_light("sky", sky(256, 128, 0)), sun_light(), gradient_light()};
    for (const std::string& path : options.environments) {
        const size_t slash = path.find_last_of('/');
        lights.push_back(environment_light(path.substr(slash == std::string::npos ? 0 : slash + 1),
                                           load_environment(path)));
    }

    Comparison comparison;
    comparison.options = options.measure;
    comparison.command = options.command;
    {
        Progress progress("compare");
        const double share = 1 / static_cast<double>(subjects.size());
        for (size_t k = 0; k < subjects.size() && !interrupted(); ++k) {
            Subject& subject = subjects[k];
            progress.show(share * static_cast<double>(k), subject.label);
            if (subject.scene.meshes.empty()) subject.scene = scenes::builtin(subject.label);
            try {
                comparison.scenes.push_back(
                    measure_scene(subject.scene, options.measure, lights, [&](double done, const char* what) {
                        progress.show(share * (static_cast<double>(k) + done), subject.label + ", " + what);
                    }));
            } catch (const Failure& failure) {
                // What was measured before is told all the same.
                if (!interrupted() || comparison.scenes.empty()) throw;
            }
            subject.scene = {};
        }
    }
    comparison.complete = !interrupted();
    comparison.seconds = (wall_ms() - start) / 1e3;

    out.add("report.json", report_json(comparison).dump(1) + "\n");
    out.add("index.html", report_page(comparison));
    out.add("tables.md", markdown_tables(comparison));
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
    std::fputs(terminal_table(comparison).c_str(), stdout);
    std::printf("%s%.0f s on %s; revision %s\n%s/index.html\n", comparison.complete ? "" : "cut short; ",
                comparison.seconds, processor_name().c_str(), source_revision(),
                printable(out.path()).c_str());
}

} // namespace nusselt::tools
