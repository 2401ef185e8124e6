#include "tools/commands/study.h"

#include "tools/commands/choice.h"
#include "tools/report/failure.h"
#include "tools/report/output.h"
#include "tools/report/progress.h"
#include "tools/report/stop.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

namespace {

struct Topic {
    const char* name;
    Study (*run)(const Subject& subject, const StudyOptions& options);
};
constexpr Topic topics[] = {{"glossy", study_glossy},   {"direct", study_direct},   {"pvs", study_pvs},
                            {"objects", study_objects}, {"falloff", study_falloff}, {"static", study_static},
                            {"sides", study_sides},     {"outputs", study_outputs}};

const Topic& topic_of(const std::string& name) {
    std::string list;
    for (const Topic& topic : topics) {
        if (name == topic.name) return topic;
        list += std::string(list.empty() ? "" : ", ") + topic.name;
    }
    throw Failure("study", "there is no topic '" + name + "'; choose " + list, exit_usage);
}

Subject subject_of(const StudyOptions& options) {
    Subject subject;
    double time = 0;
    if (options.model.empty()) {
        subject.scene = scenes::builtin(options.scene);
        subject.name = options.scene;
        if (subject.scene.meshes.empty())
            throw Failure("--scene",
                          "there is no scene '" + options.scene + "'; choose cloth, fight, chess, hand",
                          exit_usage);
        time = 0.3 * subject.scene.duration;
    } else {
        const Choice choice = choose(options.model, options.clip, true);
        subject.scene = choice.scene;
        subject.name = choice.model.name;
        time = 0.5 * subject.scene.duration;
    }
    subject.scene.pose(time, subject.pose);
    return subject;
}

} // namespace

std::string percent(double part) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2f %%", 100 * part);
    return text;
}

namespace {

std::string to_json(const Table& table, const std::string& topic, const std::string& subject) {
    nlohmann::ordered_json json = {{"topic", topic}, {"subject", subject}, {"build", configuration()}};
    json["rows"] = nlohmann::ordered_json::array();
    for (const auto& row : table.rows) {
        nlohmann::ordered_json entry;
        for (size_t k = 0; k < row.size(); ++k)
            entry[table.columns[k]] = row[k];
        json["rows"].push_back(entry);
    }
    return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

} // namespace

std::vector<double> measure_in_turns(uint32_t rounds, const std::vector<std::function<double()>>& ways) {
    std::vector<std::vector<double>> times(ways.size());
    for (uint32_t round = 0; round < rounds + 1; ++round) {
        throw_if_interrupted();
        for (size_t k = 0; k < ways.size(); ++k) {
            const double time = ways[k]();
            if (round > 0) times[k].push_back(time); // the first pays for memory that the others find there
        }
    }
    std::vector<double> medians;
    for (std::vector<double>& own : times) {
        std::sort(own.begin(), own.end());
        medians.push_back(own[own.size() / 2]);
    }
    return medians;
}

std::vector<uint32_t> choose_receivers(size_t vertices, size_t most) {
    std::vector<uint32_t> chosen;
    const size_t count = std::min(vertices, most);
    for (size_t k = 0; k < count; ++k)
        chosen.push_back(static_cast<uint32_t>(k * vertices / count));
    return chosen;
}

Reference trace_some(Assembly assembly, size_t receivers, uint32_t rays) {
    const TraceScene traced = make_trace_scene(assembly);
    // What has no normal isn't traced.
    std::vector<glm::vec3> normals(assembly.normals.size(), glm::vec3(0));
    for (const uint32_t v : choose_receivers(normals.size(), receivers))
        normals[v] = assembly.normals[v];
    assembly.normals = normals;
    TraceOptions trace;
    trace.rays = rays;
    trace.cancel = &interrupted();
    Reference reference;
    reference.transfer = trace_transfer(traced, assembly, trace).transfer;
    trace.lift = clear_lift;
    const std::vector<float> lifted = trace_transfer(traced, assembly, trace).transfer;
    throw_if_interrupted();
    reference.clear = clear_receivers(reference.transfer, lifted);
    return reference;
}

Study run_topic(const std::string& topic, const Subject& subject, const StudyOptions& options) {
    return topic_of(topic).run(subject, options);
}

void run_study(StudyOptions options) {
    (void)topic_of(options.topic);
    const Subject subject = subject_of(options);
    OutputDirectory out(options.out);
    Progress progress("study");
    options.progress = [&](double done) { progress.show(done); };
    const Study study = run_topic(options.topic, subject, options);
    out.add(options.topic + ".json", to_json(study.table, options.topic, subject.name));
    out.add(options.topic + ".txt", to_text(study.table));
    for (const auto& [name, bytes] : study.pictures)
        out.add(name, bytes);
    out.commit();
    std::printf("%s", to_text(study.table).c_str());
}

} // namespace nusselt::tools
