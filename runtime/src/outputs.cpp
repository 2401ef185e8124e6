#include "outputs.h"

#include "jobs/float_environment.h"
#include "kernels/half.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt {

namespace {

constexpr double pi = 3.14159265358979323846;

kernels::Encoding encoding_of(const Output& output) {
    kernels::Encoding e{static_cast<kernels::Quantity>(output.kind),
                        static_cast<kernels::Format>(output.format),
                        output.bands ? output.bands : 5,
                        {1, 1, 1, 1, 1}};
    const auto zero = [](float factor) { return factor == 0; };
    if (!std::all_of(output.window, output.window + 5, zero))
        std::copy(output.window, output.window + 5, e.window);
    return e;
}

size_t element_bytes(const kernels::Encoding& e) {
    return (e.quantity == kernels::Quantity::glossy ? 3 : 1) * size_t(kernels::encoded_bytes(e));
}

bool known(OutputKind kind, OutputFormat format, uint32_t bands) {
    return static_cast<uint32_t>(kind) <= static_cast<uint32_t>(OutputKind::direct) &&
           static_cast<uint32_t>(format) <= static_cast<uint32_t>(OutputFormat::packed8) && bands <= 5;
}

} // namespace

size_t output_bytes(OutputKind kind, OutputFormat format, uint32_t bands) {
    if (!known(kind, format, bands) || bands == 0) return 0;
    Output output;
    output.kind = kind;
    output.format = format;
    output.bands = bands;
    return element_bytes(encoding_of(output));
}

void unpack_transfer(const void* packed, uint32_t bands, float out[25]) {
    const jobs::FloatEnvironment environment;
    const uint8_t* p = static_cast<const uint8_t*>(packed);
    std::fill_n(out, 25, 0.0f);
    if (bands < 1 || bands > 5) return;
    const uint32_t halves = bands == 1 ? 1 : 4;
    for (uint32_t i = 0; i < halves; ++i) {
        uint16_t half;
        std::memcpy(&half, p + 2 * i, 2);
        out[i] = kernels::float_from_half(half);
    }
    const uint8_t* scale = p + 8;
    const uint8_t* term = p + 8 + (bands - 2);
    for (uint32_t band = 2; band < bands; ++band, ++scale) {
        const float unit = out[0] * kernels::band_bound[band] * float(*scale) / (127.0f * 255.0f);
        for (uint32_t i = band * band; i < (band + 1) * (band + 1); ++i)
            out[i] = float(static_cast<int8_t>(*term++)) * unit;
    }
    if (bands < 3) return;
    float expected[5];
    kernels::expected_band_2(out, expected);
    for (uint32_t i = 0; i < 5; ++i)
        out[4 + i] += expected[i];
}

void sh_window(ShWindow window, float width, float out[5]) {
    const jobs::FloatEnvironment environment;
    out[0] = 1;
    for (uint32_t band = 1; band < 5; ++band) {
        const double angle = pi * band / double(width);
        const bool inside = float(band) < width; // false for what is not a number
        const double factor = window == ShWindow::hann ? (1 + std::cos(angle)) / 2 : std::sin(angle) / angle;
        out[band] = inside ? static_cast<float>(factor) : 0.0f;
    }
}

void sh_apply_window(const float window[5], uint32_t channels, float* coefficients) {
    const jobs::FloatEnvironment environment;
    for (uint32_t band = 0; band < 5; ++band) {
        for (uint32_t i = band * band * channels; i < (band + 1) * (band + 1) * channels; ++i)
            coefficients[i] *= window[band];
    }
}

Status check_output(const Output& output) {
    const auto bad = [](const char* text) { return Status{StatusCode::invalid_argument, text}; };
    if (!known(output.kind, output.format, output.bands))
        return bad("no frame started: an output has an unknown kind or format, or more than 5 bands; use "
                   "those of nusselt/output.h");
    if (!output.data)
        return bad("no frame started: an output's data is null; leave the output out or give it memory");
    const kernels::Encoding e = encoding_of(output);
    for (const float factor : e.window) {
        if (!(factor >= 0 && factor <= 1) || e.window[0] != 1)
            return bad("no frame started: an output's window has a factor outside 0 to 1, or the first is "
                       "not 1; sh_window makes one");
    }
    if (output.kind >= OutputKind::radiance && output.format == OutputFormat::packed8)
        return bad(
            "no frame started: an output of radiance is packed8, which has no range for it; use float16");
    constexpr size_t alignments[] = {4, 2, 1};
    const size_t alignment = alignments[static_cast<uint32_t>(output.format)];
    if (reinterpret_cast<uintptr_t>(output.data) % alignment != 0 || output.stride % alignment != 0)
        return bad("no frame started: an output's data or stride is not aligned to its format's component; "
                   "align both to 4 bytes (float32) or 2 (float16)");
    if (output.stride != 0 && output.stride < element_bytes(e))
        return bad("no frame started: an output's stride is smaller than its elements, which would overwrite "
                   "one another; output_bytes tells their size");
    return {};
}

OutputStream make_stream(const Output& output) {
    OutputStream stream;
    stream.encoding = encoding_of(output);
    stream.data = static_cast<char*>(output.data);
    stream.stride = output.stride ? output.stride : element_bytes(stream.encoding);
    return stream;
}

} // namespace nusselt
