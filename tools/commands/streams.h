// Output streams by name, as the command line writes them: KIND[:FORMAT[:BANDS]].
#pragma once

#include <nusselt/output.h>

#include <cstdint>
#include <string>
#include <vector>

namespace nusselt::tools {

// One stream of all vertices, without gaps between its elements.
struct StreamArray {
    OutputKind kind = OutputKind::transfer;
    OutputFormat format = OutputFormat::float32;
    uint32_t bands = 5;
    float window[5] = {}; // all 0: none
    std::vector<uint8_t> bytes;

    size_t element() const { return output_bytes(kind, format, bands); }
};

// "ambient_occlusion", "bent_normal:packed8", "transfer:float16:3". Throws Failure (usage) with what there
// is.
StreamArray parse_stream(const std::string& text, const std::string& option);

// "transfer_float16_3": the name of its file.
std::string stream_name(const StreamArray& stream);

// The stream as a NumPy array: one row a vertex, of numbers, or of bytes where it is packed.
std::string stream_npy(const StreamArray& stream);

// Mean and 99th percentile of the relative L2 difference that a transfer stream's format makes, over
// receivers that see at least 1 %; `transfer` holds the 25 floats a vertex that it was made from.
struct FormatError {
    double mean = 0, p99 = 0;
};
FormatError format_error(const StreamArray& stream, const std::vector<float>& transfer);
// The same of ambient occlusion, in parts of an open sky, and of bent normals, in degrees, over all vertices;
// `exact` is the same stream as float32.
FormatError format_error(const StreamArray& stream, const StreamArray& exact);

} // namespace nusselt::tools
