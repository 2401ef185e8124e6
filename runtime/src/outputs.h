// Output streams: checked at `submit`, written batch by batch.
#pragma once

#include "kernels/outputs.h"
#include "nusselt/output.h"
#include "nusselt/status.h"

namespace nusselt {

// One stream as a frame keeps it.
struct OutputStream {
    kernels::Encoding encoding{};
    char* data = nullptr;
    size_t stride = 0;
};

// Whether the stream can be written; its count is checked with the mesh's.
Status check_output(const Output& output);
OutputStream make_stream(const Output& output);

} // namespace nusselt
