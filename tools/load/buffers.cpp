#include "tools/load/buffers.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <limits>

namespace nusselt::load {
namespace {

// An accessor without a view is all zeros, so its size costs the file nothing; real ones are the base of
// sparse data.
constexpr uint64_t most_zeros = 1u << 20;

std::string view_path(size_t view) {
    return "/bufferViews/" + std::to_string(view);
}

std::string accessor_path(size_t accessor) {
    return "/accessors/" + std::to_string(accessor);
}

uint64_t component_bytes(int component_type) {
    switch (component_type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return 2;
    default:
        return 4;
    }
}

// Columns of a matrix begin at multiples of 4 bytes (glTF 2.0, section 3.6.2.4).
uint64_t column_bytes(const tinygltf::Accessor& accessor, uint64_t rows) {
    return (rows * component_bytes(accessor.componentType) + 3) / 4 * 4;
}

uint64_t element_bytes(const tinygltf::Accessor& accessor) {
    switch (accessor.type) {
    case TINYGLTF_TYPE_MAT2:
        return 2 * column_bytes(accessor, 2);
    case TINYGLTF_TYPE_MAT3:
        return 3 * column_bytes(accessor, 3);
    case TINYGLTF_TYPE_MAT4:
        return 4 * column_bytes(accessor, 4);
    default:
        return static_cast<uint64_t>(component_count(accessor)) * component_bytes(accessor.componentType);
    }
}

// Without what pads the last column: the file may end there.
uint64_t reach_bytes(const tinygltf::Accessor& accessor) {
    const uint64_t rows = accessor.type == TINYGLTF_TYPE_MAT2   ? 2
                          : accessor.type == TINYGLTF_TYPE_MAT3 ? 3
                          : accessor.type == TINYGLTF_TYPE_MAT4 ? 4
                                                                : 0;
    const uint64_t padding =
        rows == 0 ? 0 : column_bytes(accessor, rows) - rows * component_bytes(accessor.componentType);
    return element_bytes(accessor) - padding;
}

// offset + (count - 1) * stride + size <= available, without overflow; count >= 1. The need is reported
// saturated.
bool fits(uint64_t offset, uint64_t count, uint64_t stride, uint64_t size, uint64_t available,
          uint64_t& need) {
    uint64_t steps = 0;
    const bool overflow = __builtin_mul_overflow(count - 1, stride, &steps) ||
                          __builtin_add_overflow(steps, size, &need) ||
                          __builtin_add_overflow(need, offset, &need);
    if (overflow) need = UINT64_MAX;
    return need <= available;
}

Bytes decompress(const CompressedView& view, std::span<const uint8_t> source, const std::string& path) {
    const auto broken = [&](const char* what) { fail("MESHOPT", path, what, export_again); };
    if (view.count == 0) broken("compressed data has no elements");
    uint64_t most = 0; // what `source` can hold at best, so that a short file can't ask for much memory
    switch (view.mode) {
    case MeshoptMode::attributes:
        if (view.stride == 0 || view.stride % 4 != 0)
            broken("compressed attributes need a stride of 4 to 256");
        most = (source.size() + view.stride) * 64; // 4 bytes hold a byte each of 256 vertices
        break;
    case MeshoptMode::triangles:
        if (view.count % 3 != 0) broken("compressed triangles are not a multiple of 3 indices");
        [[fallthrough]];
    case MeshoptMode::indices:
        if (view.stride != 2 && view.stride != 4) broken("compressed indices need a stride of 2 or 4");
        most = source.size() * 3 * view.stride; // a byte a triangle at best
        break;
    }
    if (view.count * view.stride > most) broken("compressed data is too short for its count");
    switch (view.filter) {
    case MeshoptFilter::none:
        break;
    case MeshoptFilter::octahedral:
        if (view.stride != 4 && view.stride != 8) broken("the octahedral filter needs a stride of 4 or 8");
        break;
    case MeshoptFilter::quaternion:
        if (view.stride != 8) broken("the quaternion filter needs a stride of 8");
        break;
    case MeshoptFilter::exponential:
        break;
    }
    if (view.filter != MeshoptFilter::none && view.mode != MeshoptMode::attributes) {
        broken("only attributes can be filtered");
    }

    Bytes out(view.count * view.stride);
    int error = 0;
    switch (view.mode) {
    case MeshoptMode::attributes:
        error = meshopt_decodeVertexBuffer(out.data(), view.count, view.stride, source.data(), source.size());
        break;
    case MeshoptMode::triangles:
        error = meshopt_decodeIndexBuffer(out.data(), view.count, view.stride, source.data(), source.size());
        break;
    case MeshoptMode::indices:
        error =
            meshopt_decodeIndexSequence(out.data(), view.count, view.stride, source.data(), source.size());
        break;
    }
    if (error != 0) broken("compressed data can't be decoded");
    switch (view.filter) {
    case MeshoptFilter::none:
        break;
    case MeshoptFilter::octahedral:
        meshopt_decodeFilterOct(out.data(), view.count, view.stride);
        break;
    case MeshoptFilter::quaternion:
        meshopt_decodeFilterQuat(out.data(), view.count, view.stride);
        break;
    case MeshoptFilter::exponential:
        meshopt_decodeFilterExp(out.data(), view.count, view.stride);
        break;
    }
    return out;
}

template<class Number>
Number load(const uint8_t* at) {
    Number value;
    std::memcpy(&value, at, sizeof value);
    return value;
}

float to_float(const uint8_t* at, int component_type, bool normalized) {
    switch (component_type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE: {
        const auto value = static_cast<float>(load<int8_t>(at));
        return normalized ? std::max(value / 127.0f, -1.0f) : value;
    }
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE: {
        const auto value = static_cast<float>(*at);
        return normalized ? value / 255.0f : value;
    }
    case TINYGLTF_COMPONENT_TYPE_SHORT: {
        const auto value = static_cast<float>(load<int16_t>(at));
        return normalized ? std::max(value / 32767.0f, -1.0f) : value;
    }
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT: {
        const auto value = static_cast<float>(load<uint16_t>(at));
        return normalized ? value / 65535.0f : value;
    }
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
        return static_cast<float>(load<uint32_t>(at));
    default:
        return load<float>(at);
    }
}

uint32_t to_integer(const uint8_t* at, int component_type) {
    switch (component_type) {
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return *at;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return load<uint16_t>(at);
    default:
        return load<uint32_t>(at);
    }
}

void check_sparse(const Document& document, const Buffers& buffers, size_t index) {
    const tinygltf::Accessor& accessor = document.gltf.accessors[index];
    const auto& sparse = accessor.sparse;
    const std::string path = accessor_path(index) + "/sparse";
    const auto count = static_cast<uint64_t>(sparse.count);
    if (count < 1 || count > accessor.count) {
        fail("SPARSE_COUNT", path + "/count",
             std::to_string(count) + " sparse elements of " + std::to_string(accessor.count), export_again);
    }
    const int type = sparse.indices.componentType;
    if (type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE && type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT &&
        type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT) {
        fail("SPARSE_INDICES_FORMAT", path + "/indices", "sparse indices are not unsigned integers",
             export_again);
    }
    const auto range = [&](int view, int offset, uint64_t size, const char* name) {
        uint64_t need = 0;
        const uint64_t available = buffers.views[static_cast<size_t>(view)].size();
        if (!fits(static_cast<uint64_t>(offset), count, size, size, available, need)) {
            fail("ACCESSOR_TOO_LONG", path + "/" + name,
                 "it needs " + std::to_string(need) + " bytes, its buffer view has " +
                     std::to_string(available),
                 export_again);
        }
    };
    range(sparse.indices.bufferView, sparse.indices.byteOffset, component_bytes(type), "indices");
    range(sparse.values.bufferView, sparse.values.byteOffset, element_bytes(accessor), "values");
    const uint8_t* at = buffers.views[static_cast<size_t>(sparse.indices.bufferView)].data() +
                        static_cast<size_t>(sparse.indices.byteOffset);
    uint64_t next = 0; // the least value allowed
    for (uint64_t i = 0; i < count; ++i, at += component_bytes(type)) {
        const uint64_t value = to_integer(at, type);
        if (value < next || value >= accessor.count) {
            fail("SPARSE_INDICES", path + "/indices",
                 "sparse index " + std::to_string(i) + " is " + std::to_string(value) +
                     ", out of range or not increasing",
                 export_again);
        }
        next = value + 1;
    }
}

// `zeros`: elements without data so far, of all accessors.
void check_accessor(const Document& document, const Buffers& buffers, size_t index, uint64_t& zeros) {
    const tinygltf::Accessor& accessor = document.gltf.accessors[index];
    if (accessor.bufferView < 0) {
        if (accessor.count > most_zeros - zeros) {
            fail("LIMIT_ZEROS", accessor_path(index),
                 "more than " + std::to_string(most_zeros) + " elements without data", export_again);
        }
        zeros += accessor.count;
    } else {
        const auto view = static_cast<size_t>(accessor.bufferView);
        const uint64_t size = element_bytes(accessor);
        const uint64_t given = document.gltf.bufferViews[view].byteStride;
        const uint64_t stride = given != 0 ? given : size;
        if (stride < size) {
            fail("ACCESSOR_SMALL_BYTESTRIDE", view_path(view),
                 "elements of " + std::to_string(size) + " bytes at a stride of " + std::to_string(stride),
                 export_again);
        }
        uint64_t need = 0;
        const uint64_t available = buffers.views[view].size();
        if (!fits(accessor.byteOffset, accessor.count, stride, reach_bytes(accessor), available, need)) {
            fail("ACCESSOR_TOO_LONG", accessor_path(index),
                 "it needs " + (need == UINT64_MAX ? "too many" : std::to_string(need)) +
                     " bytes, buffer view " + std::to_string(view) + " has " + std::to_string(available),
                 export_again);
        }
    }
    if (accessor.sparse.isSparse) check_sparse(document, buffers, index);
}

// Calls element(number of the element, its bytes) for all elements with data, sparse ones last.
template<class Element>
void each_element(const Document& document, const Buffers& buffers, const tinygltf::Accessor& accessor,
                  Element element) {
    const uint64_t size = element_bytes(accessor);
    if (accessor.bufferView >= 0) {
        const auto view = static_cast<size_t>(accessor.bufferView);
        const uint64_t given = document.gltf.bufferViews[view].byteStride;
        const uint64_t stride = given != 0 ? given : size;
        const uint8_t* at = buffers.views[view].data() + accessor.byteOffset;
        for (size_t i = 0; i < accessor.count; ++i) {
            element(i, at + i * stride);
        }
    }
    if (!accessor.sparse.isSparse) return;
    const auto& sparse = accessor.sparse;
    const uint8_t* indices = buffers.views[static_cast<size_t>(sparse.indices.bufferView)].data() +
                             static_cast<size_t>(sparse.indices.byteOffset);
    const uint8_t* values = buffers.views[static_cast<size_t>(sparse.values.bufferView)].data() +
                            static_cast<size_t>(sparse.values.byteOffset);
    for (size_t i = 0; i < static_cast<size_t>(sparse.count); ++i) {
        element(to_integer(indices + i * component_bytes(sparse.indices.componentType),
                           sparse.indices.componentType),
                values + i * size);
    }
}

bool is_value(double given, float value) {
    return std::abs(given) <= double(FLT_MAX) && static_cast<float>(given) == value;
}

// What the file says of an accessor's values against the values, as floats where they are. Nothing here reads
// bounds; ones that are wrong say that the file was changed by hand, or damaged. Returns whether they hold.
bool bounds_hold(const Document& document, const Buffers& buffers, const tinygltf::Accessor& accessor) {
    const auto components = static_cast<size_t>(component_count(accessor));
    const bool is_matrix = accessor.type == TINYGLTF_TYPE_MAT2 || accessor.type == TINYGLTF_TYPE_MAT3 ||
                           accessor.type == TINYGLTF_TYPE_MAT4;
    const bool has_low = accessor.minValues.size() == components,
               has_high = accessor.maxValues.size() == components;
    // Without a view the file has no values, but sparse ones.
    if (is_matrix || accessor.bufferView < 0 || !(has_low || has_high)) return true;
    const size_t step = component_bytes(accessor.componentType);
    float low[4], high[4];
    std::fill_n(low, 4, std::numeric_limits<float>::infinity());
    std::fill_n(high, 4, -std::numeric_limits<float>::infinity());
    each_element(document, buffers, accessor, [&](size_t, const uint8_t* at) {
        for (size_t k = 0; k < components; ++k) {
            const float value = to_float(at + k * step, accessor.componentType, false);
            low[k] = std::min(low[k], value);
            high[k] = std::max(high[k], value);
        }
    });
    for (size_t k = 0; k < components; ++k) {
        if ((has_low && !is_value(accessor.minValues[k], low[k])) ||
            (has_high && !is_value(accessor.maxValues[k], high[k])))
            return false;
    }
    return true;
}

// Told once a file: a writer that rounds bounds rounds them all.
void warn_of_bounds(Document& document, const Buffers& buffers) {
    size_t first = 0, wrong = 0;
    for (size_t i = document.gltf.accessors.size(); i-- > 0;) {
        if (bounds_hold(document, buffers, document.gltf.accessors[i])) continue;
        first = i;
        ++wrong;
    }
    if (wrong == 0) return;
    warn(document.warnings, "ACCESSOR_BOUNDS",
         accessor_path(first) + ": its min or max is not what its data has" +
             (wrong > 1 ? ", and so of " + std::to_string(wrong - 1) + " others" : std::string()) +
             "; they are not read");
}

} // namespace

int component_count(const tinygltf::Accessor& accessor) {
    return tinygltf::GetNumComponentsInType(static_cast<uint32_t>(accessor.type));
}

Buffers read_buffers(Document& document, const std::string& asset_path, std::span<const uint8_t> binary_chunk,
                     const LoadLimits& limits) {
    Buffers out;
    uint64_t total = 0;
    const auto reserve = [&](uint64_t bytes, const std::string& path) {
        if (bytes > limits.buffer_bytes - total) {
            fail("LIMIT_BUFFERS", path,
                 "the buffers together have more than " + std::to_string(limits.buffer_bytes >> 20) + " MiB",
                 "raise the limit if you trust it");
        }
        total += bytes;
    };

    // Spans into `owned` stay valid: moving a Bytes keeps its memory.
    std::vector<std::span<const uint8_t>> buffers(document.buffers.size());
    for (size_t i = 0; i < buffers.size(); ++i) {
        BufferSource& source = document.buffers[i];
        const std::string path = "/buffers/" + std::to_string(i);
        if (source.uri) {
            reserve(source.bytes, path);
            out.owned.push_back(
                source.uri->starts_with("data:")
                    ? decode_data_uri(*source.uri, path + "/uri")
                    : read_beneath(asset_path, *source.uri, limits.buffer_bytes, path + "/uri"));
            source.uri.reset();
            buffers[i] = out.owned.back();
        } else if (i == 0 && binary_chunk.data()) {
            buffers[i] = binary_chunk;
        } else {
            continue; // no data: the fallback of compressed views
        }
        if (buffers[i].size() < source.bytes) {
            fail("BUFFER_TOO_SHORT", path,
                 "it says " + std::to_string(source.bytes) + " bytes and has " +
                     std::to_string(buffers[i].size()),
                 file_incomplete);
        }
        buffers[i] = buffers[i].first(source.bytes);
    }

    const auto slice = [&](int buffer, uint64_t offset, uint64_t bytes, const std::string& path) {
        const std::span<const uint8_t> from = buffers[static_cast<size_t>(buffer)];
        if (!from.data()) {
            fail("BUFFER_MISSING", path, "buffer " + std::to_string(buffer) + " has no data",
                 file_incomplete);
        }
        if (offset > from.size() || bytes > from.size() - offset) {
            fail("BUFFER_VIEW_TOO_LONG", path,
                 std::to_string(bytes) + " bytes from " + std::to_string(offset) + ", the buffer has " +
                     std::to_string(from.size()),
                 export_again);
        }
        return from.subspan(offset, bytes);
    };
    for (size_t i = 0; i < document.gltf.bufferViews.size(); ++i) {
        const tinygltf::BufferView& view = document.gltf.bufferViews[i];
        if (const auto& compressed = document.compressed[i]) {
            const auto source =
                slice(compressed->buffer, compressed->offset, compressed->bytes, view_path(i));
            reserve(compressed->count * compressed->stride, view_path(i));
            out.owned.push_back(decompress(*compressed, source, view_path(i)));
            out.views.push_back(out.owned.back());
        } else {
            out.views.push_back(slice(view.buffer, view.byteOffset, view.byteLength, view_path(i)));
        }
    }
    uint64_t zeros = 0;
    for (size_t i = 0; i < document.gltf.accessors.size(); ++i) {
        check_accessor(document, out, i, zeros);
    }
    warn_of_bounds(document, out);
    return out;
}

std::vector<float> read_floats(const Document& document, const Buffers& buffers, int index) {
    const tinygltf::Accessor& accessor = document.gltf.accessors[static_cast<size_t>(index)];
    const auto components = static_cast<size_t>(component_count(accessor));
    const size_t step = component_bytes(accessor.componentType);
    std::vector<float> out(accessor.count * components);
    each_element(document, buffers, accessor, [&](size_t i, const uint8_t* at) {
        for (size_t k = 0; k < components; ++k) {
            out[i * components + k] = to_float(at + k * step, accessor.componentType, accessor.normalized);
        }
    });
    return out;
}

std::vector<uint32_t> read_integers(const Document& document, const Buffers& buffers, int index) {
    const tinygltf::Accessor& accessor = document.gltf.accessors[static_cast<size_t>(index)];
    const auto components = static_cast<size_t>(component_count(accessor));
    const size_t step = component_bytes(accessor.componentType);
    std::vector<uint32_t> out(accessor.count * components);
    each_element(document, buffers, accessor, [&](size_t i, const uint8_t* at) {
        for (size_t k = 0; k < components; ++k) {
            out[i * components + k] = to_integer(at + k * step, accessor.componentType);
        }
    });
    return out;
}

} // namespace nusselt::load
