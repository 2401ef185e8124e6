// A comparison told: as a table, as JSON (docs/compare.md, docs/compare.schema.json), as Markdown, as a page.
#pragma once

#include "tools/compare/measure.h"
#include "tools/compare/sizes.h"
#include "tools/report/table.h"

#include <nlohmann/json_fwd.hpp>

#include <string>
#include <vector>

namespace nusselt::tools {

// A model that could not be measured.
struct Unmeasured {
    std::string name, reason;
};

// What `nusselt study` has to say about a scene, with few receivers, rays and rounds.
struct StudyReport {
    std::string scene, topic;
    Table table;
};

struct Comparison {
    MeasureOptions options;
    std::string command;
    bool complete = true; // not cut short
    double seconds = 0;
    std::vector<SceneReport> scenes;
    std::vector<Unmeasured> failures;
    std::vector<SizePoint> sizes; // empty: not measured
    std::vector<StudyReport> studies;
};

// The reading of the format; grows with every change that a reader can trip over.
constexpr const char* report_schema = "nusselt-compare-1";

std::string processor_name();
// Of the sources that this program was built from; "unknown" outside a repository.
const char* source_revision();

nlohmann::ordered_json report_json(const Comparison& comparison);
std::string terminal_table(const Comparison& comparison);
// One line a scene: quality standard against its floor and against the peer.
std::string summary_table(const Comparison& comparison);
// Tables 1 and 2 of the paper beside ours, and run time against error. For the README.
std::string markdown_tables(const Comparison& comparison);
// Glossy, direct light, objects: what tables.md has besides.
std::string markdown_studies(const Comparison& comparison);
// `text` with what stands between the markers replaced. Throws Failure (about `path`) where they are missing.
std::string with_tables(const std::string& text, const std::string& tables, const std::string& path);

// index.html, with everything in it.
std::string report_page(const Comparison& comparison);

} // namespace nusselt::tools
