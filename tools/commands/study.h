// `nusselt study TOPIC`: what the method's further parts cost and how wrong they are, as a table and JSON.
#pragma once

#include "tools/commands/engine.h"
#include "tools/report/table.h"
#include "tools/trace/trace.h"

#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace nusselt::tools {

struct StudyOptions {
    std::string topic, model, scene = "hand", out, clip;
    bool quick = false; // few receivers, rays and rounds
    bool pictures = true;
    uint32_t most_objects = 64;
    Quality quality = Quality::standard;
    EngineOptions engine; // one thread unless told otherwise
    std::function<void(double done)> progress = [](double) {};
};
void run_study(StudyOptions options);

// A scene in one pose, ready to be measured.
struct Subject {
    std::string name;
    scenes::Scene scene;
    scenes::Pose pose;
};

struct Study {
    Table table; // printed, and written as JSON, one object a row
    std::vector<std::pair<std::string, std::string>> pictures; // name and bytes, written beside
};
// Throws Failure where there is no such topic.
Study run_topic(const std::string& topic, const Subject& subject, const StudyOptions& options);

std::string percent(double part);

// Processor milliseconds of each of several ways to run a frame: medians of rounds in which they take turns.
std::vector<double> measure_in_turns(uint32_t rounds, const std::vector<std::function<double()>>& ways);

// Receivers with a reference: evenly chosen, at most so many.
std::vector<uint32_t> choose_receivers(size_t vertices, size_t most);

// Transfer vectors of some receivers, ray-traced, zeros elsewhere, and which of those touch nothing.
struct Reference {
    std::vector<float> transfer;
    std::vector<uint8_t> clear;
};
Reference trace_some(Assembly assembly, size_t receivers, uint32_t rays);

// The topics.
Study study_glossy(const Subject& subject, const StudyOptions& options);
Study study_direct(const Subject& subject, const StudyOptions& options);
Study study_pvs(const Subject& subject, const StudyOptions& options);
Study study_objects(const Subject& subject, const StudyOptions& options);
Study study_falloff(const Subject& subject, const StudyOptions& options);
Study study_static(const Subject& subject, const StudyOptions& options);
Study study_sides(const Subject& subject, const StudyOptions& options);
Study study_outputs(const Subject& subject, const StudyOptions& options);

} // namespace nusselt::tools
