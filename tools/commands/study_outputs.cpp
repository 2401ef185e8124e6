// Output streams: what each costs beside transfer vectors and instead of them, and what its format loses.
#include "tools/commands/study.h"

#include <algorithm>
#include <cstdio>

namespace nusselt::tools {

Study study_outputs(const Subject& subject, const StudyOptions& options) {
    Study study;
    study.table.columns = {"output",        "bytes a vertex",      "beside transfer",
                           "instead of it", "error of the format", "p99"};
    constexpr const char* names[] = {
        "transfer:float32",          "transfer:float16",          "transfer:packed8",
        "transfer:float32:3",        "transfer:packed8:3",        "ambient_occlusion:float32",
        "ambient_occlusion:float16", "ambient_occlusion:packed8", "bent_normal:float32",
        "bent_normal:float16",       "bent_normal:packed8"};
    Engine plain(subject.scene, options.engine, subject.name),
        beside(subject.scene, options.engine, subject.name),
        instead(subject.scene, options.engine, subject.name);
    instead.make_streams_alone(true);
    std::vector<float> transfer, none;
    double done = 0;
    std::vector<StreamArray> exact; // as floats, of the kind at hand
    for (const char* name : names) {
        std::vector<StreamArray> streams{parse_stream(name, "study")}, alone = streams;
        const std::vector<double> times = measure_in_turns(
            options.quick ? 7 : 21,
            {[&] { return plain.frame(subject.pose, options.quality, transfer).cpu_ms; },
             [&] { return beside.frame(subject.pose, options.quality, transfer, nullptr, &streams).cpu_ms; },
             [&] { return instead.frame(subject.pose, options.quality, none, nullptr, &alone).cpu_ms; }});
        const auto text = [](const char* format, double value) {
            char out[32];
            std::snprintf(out, sizeof out, format, value);
            return std::string(out);
        };
        const StreamArray& stream = streams[0];
        if (stream.format == OutputFormat::float32) exact = streams;
        const bool bent = stream.kind == OutputKind::bent_normal;
        const FormatError error = stream.kind == OutputKind::transfer ? format_error(stream, transfer)
                                                                      : format_error(stream, exact[0]);
        const auto written = [&](double value) {
            return bent ? text("%.3f degrees", value) : text("%.3f %%", 100 * value);
        };
        study.table.rows.push_back({name, std::to_string(stream.element()),
                                    text("%.3f x", times[1] / times[0]), text("%.3f x", times[2] / times[0]),
                                    written(error.mean), written(error.p99)});
        options.progress(++done / std::size(names));
    }
    return study;
}

} // namespace nusselt::tools
