// `nusselt study TOPIC`: what the method's further parts cost and how wrong they are, as a table and JSON.
#pragma once

#include "tools/commands/engine.h"

#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace nusselt::tools {

struct StudyOptions {
    std::string topic, model, scene = "hand", out, clip;
    bool quick = false; // few receivers, rays and rounds
    Quality quality = Quality::standard;
    EngineOptions engine; // one thread unless told otherwise
};
void run_study(const StudyOptions& options);

// A scene in one pose, ready to be measured.
struct Subject {
    std::string name;
    scenes::Scene scene;
    scenes::Pose pose;
};

// A table of texts, printed with aligned columns and written as JSON, one object a row.
struct Table {
    std::vector<std::string> columns;
    std::vector<std::vector<std::string>> rows;
    std::vector<std::pair<std::string, std::string>> pictures; // name and bytes, written beside
};
std::string to_text(const Table& table);
std::string to_json(const Table& table, const std::string& topic, const std::string& subject);
std::string percent(double part);

// Processor milliseconds of each of several ways to run a frame: medians of rounds in which they take turns.
std::vector<double> measure_in_turns(uint32_t rounds, const std::vector<std::function<double()>>& ways);

// Receivers with a reference: evenly chosen, at most so many.
std::vector<uint32_t> choose_receivers(size_t vertices, size_t most);

// The topics.
Table study_glossy(const Subject& subject, const StudyOptions& options);
Table study_direct(const Subject& subject, const StudyOptions& options);
Table study_objects(const Subject& subject, const StudyOptions& options);

} // namespace nusselt::tools
