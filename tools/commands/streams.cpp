#include "tools/commands/streams.h"

#include "tools/commands/arguments.h"
#include "tools/report/failure.h"
#include "tools/report/npy.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace nusselt::tools {

namespace {

constexpr const char* kind_names[] = {"transfer", "ambient_occlusion", "bent_normal",
                                      "glossy",   "radiance",          "direct"};
constexpr size_t kinds_of_the_command_line = 3; // the others need a viewer
constexpr const char* format_names[] = {"float32", "float16", "packed8"};

float half_to_float(uint16_t half) {
    const int exponent = half >> 10 & 31, mantissa = half & 1023;
    const double size = exponent ? std::ldexp(1024 + mantissa, exponent - 25) : std::ldexp(mantissa, -24);
    return static_cast<float>(half & 0x8000 ? -size : size);
}

} // namespace

StreamArray parse_stream(const std::string& text, const std::string& option) {
    const auto refuse = [&](const std::string& part) {
        return Failure(
            option,
            "'" + text + "' has no meaning at '" + part +
                "'; write KIND[:FORMAT[:BANDS]] with a kind of transfer, ambient_occlusion, "
                "bent_normal, a format of float32, float16, packed8, and 1 to 5 bands of a transfer",
            exit_usage);
    };
    const std::vector<std::string> parts = split_at_colons(text);
    StreamArray stream;
    const auto* const end = kind_names + kinds_of_the_command_line;
    const auto* const kind = std::find(kind_names, end, parts[0]);
    if (kind == end) throw refuse(parts[0]);
    stream.kind = static_cast<OutputKind>(kind - kind_names);
    if (parts.size() > 1) {
        const auto format = std::find(std::begin(format_names), std::end(format_names), parts[1]);
        if (format == std::end(format_names)) throw refuse(parts[1]);
        stream.format = static_cast<OutputFormat>(format - format_names);
    }
    if (parts.size() > 2) {
        const bool digit = parts[2].size() == 1 && parts[2][0] >= '1' && parts[2][0] <= '5';
        if (!digit || stream.kind != OutputKind::transfer) throw refuse(parts[2]);
        stream.bands = static_cast<uint32_t>(parts[2][0] - '0');
    }
    if (parts.size() > 3) throw refuse(parts[3]);
    return stream;
}

std::string stream_name(const StreamArray& stream) {
    std::string name = kind_names[static_cast<uint32_t>(stream.kind)];
    name += std::string("_") + format_names[static_cast<uint32_t>(stream.format)];
    if (stream.kind == OutputKind::transfer && stream.bands != 5) name += "_" + std::to_string(stream.bands);
    return name;
}

std::string stream_npy(const StreamArray& stream) {
    const size_t rows = stream.bytes.size() / stream.element();
    switch (stream.format) {
    case OutputFormat::float32:
        return npy(reinterpret_cast<const float*>(stream.bytes.data()), {rows, stream.element() / 4});
    case OutputFormat::float16:
        return npy_half(reinterpret_cast<const uint16_t*>(stream.bytes.data()), {rows, stream.element() / 2});
    case OutputFormat::packed8:
        break;
    }
    // A bent normal's bytes are signed; those of a packed transfer vector are a mixture.
    if (stream.kind == OutputKind::bent_normal)
        return npy(reinterpret_cast<const int8_t*>(stream.bytes.data()), {rows, stream.element()});
    return npy(stream.bytes.data(), {rows, stream.element()});
}

namespace {

// A stream's numbers of one vertex, whose kind is no packed transfer vector.
void read_numbers(const StreamArray& stream, size_t vertex, uint32_t count, float* out) {
    const uint8_t* element = stream.bytes.data() + vertex * stream.element();
    for (uint32_t i = 0; i < count; ++i) {
        uint16_t half;
        switch (stream.format) {
        case OutputFormat::float32:
            std::memcpy(out + i, element + size_t{4} * i, 4);
            break;
        case OutputFormat::float16:
            std::memcpy(&half, element + size_t{2} * i, 2);
            out[i] = half_to_float(half);
            break;
        case OutputFormat::packed8:
            out[i] = stream.kind == OutputKind::bent_normal
                         ? static_cast<float>(static_cast<int8_t>(element[i])) / 127
                         : static_cast<float>(element[i]) / 255;
        }
    }
}

FormatError mean_and_p99(std::vector<double>& errors) {
    FormatError result;
    if (errors.empty()) return result;
    std::sort(errors.begin(), errors.end());
    for (const double e : errors)
        result.mean += e / static_cast<double>(errors.size());
    result.p99 = errors[errors.size() * 99 / 100];
    return result;
}

} // namespace

FormatError format_error(const StreamArray& stream, const std::vector<float>& transfer) {
    const uint32_t terms = stream.bands * stream.bands;
    std::vector<double> errors;
    for (size_t v = 0; v * 25 < transfer.size(); ++v) {
        const float* exact = transfer.data() + 25 * v;
        float read[25];
        if (stream.format == OutputFormat::packed8) {
            unpack_transfer(stream.bytes.data() + v * stream.element(), stream.bands, read);
        } else {
            read_numbers(stream, v, terms, read);
        }
        double square = 0, size = 0;
        for (uint32_t i = 0; i < terms; ++i) {
            const uint32_t band = (i > 0) + (i > 3) + (i > 8) + (i > 15);
            const double wanted = double{exact[i]} * (stream.window[0] > 0 ? stream.window[band] : 1.0f);
            square += (wanted - read[i]) * (wanted - read[i]);
            size += wanted * wanted;
        }
        constexpr double one_percent = 0.0028209479;
        if (exact[0] > one_percent) errors.push_back(std::sqrt(square / size));
    }
    return mean_and_p99(errors);
}

FormatError format_error(const StreamArray& stream, const StreamArray& exact) {
    const bool bent = stream.kind == OutputKind::bent_normal;
    const uint32_t numbers = bent ? 3 : 1;
    std::vector<double> errors;
    for (size_t v = 0; v * stream.element() < stream.bytes.size(); ++v) {
        float a[3] = {}, b[3] = {};
        read_numbers(stream, v, numbers, a);
        read_numbers(exact, v, numbers, b);
        // Between directions by the cross product: an arc cosine would see nothing below 0.02 degrees.
        const double x = double{a[1]} * b[2] - double{a[2]} * b[1],
                     y = double{a[2]} * b[0] - double{a[0]} * b[2],
                     z = double{a[0]} * b[1] - double{a[1]} * b[0];
        const double along = double{a[0]} * b[0] + double{a[1]} * b[1] + double{a[2]} * b[2];
        errors.push_back(bent ? std::atan2(std::sqrt(x * x + y * y + z * z), along) * 57.29577951308232
                              : std::fabs(double{a[0]} - b[0]));
    }
    return mean_and_p99(errors);
}

} // namespace nusselt::tools
