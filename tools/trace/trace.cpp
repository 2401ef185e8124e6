#include "tools/trace/trace.h"

#include "tools/report/failure.h"
#include "tools/trace/parallel.h"
#include "tools/trace/sh.h"

#include <embree3/rtcore.h>
#include <glm/geometric.hpp>
#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <mutex>
#include <numbers>
#include <unordered_map>

namespace nusselt::tools {

namespace {

// Embree asks for flushed denormals in the threads that call it.
struct FlushDenormals {
    unsigned saved = _mm_getcsr();
    FlushDenormals() {
        _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
        _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    }
    ~FlushDenormals() { _mm_setcsr(saved); }
    FlushDenormals(const FlushDenormals&) = delete;
    FlushDenormals& operator=(const FlushDenormals&) = delete;
};

uint64_t scramble(uint64_t x) {
    // SplitMix64's finaliser.
    x += 0x9E3779B97F4A7C15u;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
    return x ^ (x >> 31);
}

struct Random {
    uint64_t state;
    // In [0, 1), 32 bits of it.
    double operator()() {
        state += 0x9E3779B97F4A7C15u;
        return static_cast<double>(scramble(state) >> 32) * 0x1p-32;
    }
};

using PointKey = std::array<uint32_t, 3>;

struct PointHash {
    size_t operator()(const PointKey& key) const {
        return scramble(scramble(scramble(key[0]) ^ key[1]) ^ key[2]);
    }
};

PointKey key_of(const glm::vec3& p) {
    // Adding zero makes -0 and +0 the same bits.
    return {std::bit_cast<uint32_t>(p.x + 0.0f), std::bit_cast<uint32_t>(p.y + 0.0f),
            std::bit_cast<uint32_t>(p.z + 0.0f)};
}

bool finite(const glm::vec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

struct RayContext {
    RTCIntersectContext base;
    const uint32_t* incident_begin;
    const uint32_t* incident_end;
    Facing facing;
};

// Turns down hits on the receiver's own triangles, and on back faces where those don't block.
void own_filter(const RTCFilterFunctionNArguments* arguments) {
    const auto* context = reinterpret_cast<const RayContext*>(arguments->context);
    const unsigned count = arguments->N;
    for (unsigned i = 0; i < count; ++i) {
        if (arguments->valid[i] != -1) continue;
        const unsigned triangle = RTCHitN_primID(arguments->hit, count, i);
        bool rejected =
            std::find(context->incident_begin, context->incident_end, triangle) != context->incident_end;
        if (!rejected && context->facing == Facing::front) {
            // Embree's geometric normal (v1 - v0) x (v2 - v0) points outward here.
            const float facing =
                RTCHitN_Ng_x(arguments->hit, count, i) * RTCRayN_dir_x(arguments->ray, count, i) +
                RTCHitN_Ng_y(arguments->hit, count, i) * RTCRayN_dir_y(arguments->ray, count, i) +
                RTCHitN_Ng_z(arguments->hit, count, i) * RTCRayN_dir_z(arguments->ray, count, i);
            rejected = facing >= 0;
        }
        if (rejected) arguments->valid[i] = 0;
    }
}

// From the unit square to the unit disk, keeping areas (Shirley, Chiu 1997).
void concentric(double u, double v, double& x, double& y) {
    constexpr double quarter = std::numbers::pi / 4;
    const double a = 2 * u - 1, b = 2 * v - 1;
    if (a == 0 && b == 0) {
        x = y = 0;
    } else if (std::abs(a) > std::abs(b)) {
        const double angle = quarter * (b / a);
        x = a * std::cos(angle);
        y = a * std::sin(angle);
    } else {
        const double angle = quarter * (a / b);
        x = b * std::sin(angle);
        y = b * std::cos(angle);
    }
}

struct Scratch {
    Fan fan;
    std::vector<glm::dvec3> corners;
    std::vector<glm::dvec3> direction; // of each sample
    std::vector<double> hidden;        // part of each sample
};

// What something at that distance hides.
double hidden_part(const TraceOptions& options, double distance) {
    if (distance <= options.fade_from) return 1;
    if (distance >= options.fade_to) return 0;
    const double t = (options.fade_to - distance) / (options.fade_to - options.fade_from);
    return t * t * (3 - 2 * t);
}

// An edge within a ten-thousandth of a radian of the normal: rounding decides to which side it leans, and so
// whether a quarter of the hemisphere is under its triangle. A ray that starts a hair above the receiver
// passes.
bool is_upright(const glm::dvec3& edge, const glm::dvec3& normal) {
    const double up = glm::dot(edge, normal);
    const glm::dvec3 across = edge - up * normal;
    return up > 0 && glm::dot(across, across) < 1e-8 * up * up;
}

// The fan of incident triangles of a vertex.
void gather_fan(const TraceScene& scene, const Assembly& all, uint32_t vertex, const glm::dvec3& normal,
                Scratch& scratch) {
    const uint32_t point = scene.point[vertex];
    scratch.corners.clear();
    for (uint32_t k = scene.incident_begin[point]; k < scene.incident_begin[point + 1]; ++k) {
        const uint32_t* corner = &all.indices[size_t{3} * scene.incident[k]];
        const int own = scene.point[corner[0]] == point ? 0 : scene.point[corner[1]] == point ? 1 : 2;
        const glm::vec3 &a = all.positions[corner[(own + 1) % 3]], &b = all.positions[corner[(own + 2) % 3]];
        if (!finite(a) || !finite(b)) continue;
        scratch.corners.push_back(a);
        scratch.corners.push_back(b);
    }
    make_fan(glm::dvec3(all.positions[vertex]), normal, scratch.corners, scratch.fan);
}

// One set of grid x grid jittered rays from one receiver; `sum` becomes their mean.
void trace_receiver(const TraceScene& scene, const glm::dvec3& origin, const glm::dvec3& normal,
                    uint32_t point, uint32_t grid, const TraceOptions& options, Random random,
                    Scratch& scratch, double sum[25]) {
    // Duff et al. 2017, Building an Orthonormal Basis, Revisited.
    const double sign = std::copysign(1.0, normal.z);
    const double a = -1 / (sign + normal.z), b = normal.x * normal.y * a;
    const glm::dvec3 tangent(1 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x);
    const glm::dvec3 bitangent(b, sign + normal.y * normal.y * a, -normal.y);

    const size_t samples = size_t{grid} * grid;
    scratch.direction.resize(samples);
    scratch.hidden.resize(samples);
    RayContext context;
    rtcInitIntersectContext(&context.base);
    context.base.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    context.incident_begin = scene.incident.data() + scene.incident_begin[point];
    context.incident_end = scene.incident.data() + scene.incident_begin[point + 1];
    context.facing = options.facing;
    if (options.fade_to > 0) context.base.filter = own_filter;

    const double step = 1.0 / grid;
    double hidden = 0;
    size_t sample = 0;
    // Packets of 16 rays through neighbouring cells.
    for (uint32_t block_y = 0; block_y < grid; block_y += 4) {
        for (uint32_t block_x = 0; block_x < grid; block_x += 4) {
            alignas(64) int valid[16];
            alignas(64) RTCRayHit16 hits{};
            RTCRay16& rays = hits.ray;
            for (uint32_t k = 0; k < 16; ++k) {
                const double u = (block_x + k % 4 + random()) * step;
                const double v = (block_y + k / 4 + random()) * step;
                double x = 0, y = 0;
                concentric(u, v, x, y);
                const double z = std::sqrt(std::max(0.0, 1 - x * x - y * y));
                const glm::dvec3 s = x * tangent + y * bitangent + z * normal;
                scratch.direction[sample + k] = s;
                valid[k] = hidden_by(scratch.fan, s) ? 0 : -1;
                rays.org_x[k] = static_cast<float>(origin.x);
                rays.org_y[k] = static_cast<float>(origin.y);
                rays.org_z[k] = static_cast<float>(origin.z);
                rays.dir_x[k] = static_cast<float>(s.x);
                rays.dir_y[k] = static_cast<float>(s.y);
                rays.dir_z[k] = static_cast<float>(s.z);
                rays.tnear[k] = 0;
                rays.tfar[k] = INFINITY;
                rays.time[k] = 0;
                rays.mask[k] = ~0u;
                rays.id[k] = k;
                rays.flags[k] = 0;
            }
            if (options.fade_to > 0) {
                std::fill(std::begin(hits.hit.geomID), std::end(hits.hit.geomID), RTC_INVALID_GEOMETRY_ID);
                rtcIntersect16(valid, scene.scene.get(), &context.base, &hits);
            } else {
                rtcOccluded16(valid, scene.scene.get(), &context.base, &rays);
            }
            for (uint32_t k = 0; k < 16; ++k) {
                double part = valid[k] == 0 || rays.tfar[k] < 0;
                if (options.fade_to > 0 && valid[k] != 0)
                    part = hidden_part(options, static_cast<double>(rays.tfar[k]));
                scratch.hidden[sample + k] = part;
                hidden += part;
            }
            sample += 16;
        }
    }

    // Either the open rays are summed, or the blocked ones are taken from what an open hemisphere has,
    // exactly: the fewer, since what is known exactly adds no noise.
    const bool from_open = hidden * 2 < static_cast<double>(samples);
    double part[25] = {};
    for (size_t k = 0; k < samples; ++k) {
        const double share = from_open ? scratch.hidden[k] : 1 - scratch.hidden[k];
        if (share == 0) continue;
        double basis[25];
        const glm::dvec3& s = scratch.direction[k];
        sh_basis(s.x, s.y, s.z, basis);
        for (int i = 0; i < 25; ++i)
            part[i] += share * basis[i];
    }
    // A cosine-distributed ray has the density cos / pi, which is the integrand's own factor.
    const double mean = 1.0 / static_cast<double>(samples);
    double open[25] = {};
    if (from_open) open_transfer(normal.x, normal.y, normal.z, open);
    for (int i = 0; i < 25; ++i)
        sum[i] = from_open ? open[i] - part[i] * mean : part[i] * mean;
}

} // namespace

TraceScene make_trace_scene(const Assembly& all) {
    TraceScene result{{rtcNewDevice(nullptr), rtcReleaseDevice}, {nullptr, rtcReleaseScene}, {}, {}, {}, 0};
    if (!result.device)
        throw Failure("Embree", "cannot be started; this machine or its installation lacks what it needs");
    RTCDevice device = result.device.get();
    if (!rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_FILTER_FUNCTION_SUPPORTED)) {
        throw Failure("Embree",
                      "was built without filter functions; install one with EMBREE_FILTER_FUNCTION=ON");
    }
    const FlushDenormals guard;
    result.scene.reset(rtcNewScene(device));
    // Who looks for the nearest hit brings a filter, or none.
    rtcSetSceneFlags(result.scene.get(), static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST |
                                                                    RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION));
    const size_t triangles = all.indices.size() / 3;
    if (triangles > 0) {
        RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        void* positions = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                  sizeof(glm::vec3), all.positions.size());
        void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                3 * sizeof(uint32_t), triangles);
        if (!positions || !indices) {
            rtcReleaseGeometry(geometry);
            throw Failure("Embree",
                          "has no memory for the scene; close other programs or use a smaller model");
        }
        std::memcpy(positions, all.positions.data(), all.positions.size() * sizeof(glm::vec3));
        std::memcpy(indices, all.indices.data(), triangles * 3 * sizeof(uint32_t));
        rtcSetGeometryOccludedFilterFunction(geometry, own_filter);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(result.scene.get(), geometry);
        rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(result.scene.get());
    if (rtcGetDeviceError(device) != RTC_ERROR_NONE) {
        throw Failure("Embree",
                      "could not build the scene, most likely for lack of memory; use a smaller model");
    }

    std::unordered_map<PointKey, uint32_t, PointHash> points;
    points.reserve(all.positions.size());
    for (const glm::vec3& position : all.positions)
        result.point.push_back(
            points.try_emplace(key_of(position), static_cast<uint32_t>(points.size())).first->second);
    const auto for_each_corner = [&](const auto& visit) {
        for (uint32_t t = 0; t < triangles; ++t) {
            const uint32_t p[3] = {result.point[all.indices[3 * t]], result.point[all.indices[3 * t + 1]],
                                   result.point[all.indices[3 * t + 2]]};
            for (int k = 0; k < 3; ++k)
                if ((k < 1 || p[k] != p[0]) && (k < 2 || p[k] != p[1])) visit(p[k], t);
        }
    };
    result.incident_begin.assign(points.size() + 1, 0);
    for_each_corner([&](uint32_t point, uint32_t) { ++result.incident_begin[point + 1]; });
    for (size_t p = 0; p < points.size(); ++p)
        result.incident_begin[p + 1] += result.incident_begin[p];
    result.incident.resize(result.incident_begin.back());
    std::vector<uint32_t> next(result.incident_begin.begin(), result.incident_begin.end() - 1);
    for_each_corner([&](uint32_t point, uint32_t triangle) { result.incident[next[point]++] = triangle; });

    Bounds bounds;
    grow(bounds, all.positions);
    result.diagonal = diagonal(bounds);
    return result;
}

void make_fan(const glm::dvec3& receiver, const glm::dvec3& normal, const std::vector<glm::dvec3>& corners,
              Fan& fan) {
    fan.planes.clear();
    for (size_t k = 0; k + 1 < corners.size(); k += 2) {
        const glm::dvec3 a = corners[k] - receiver, b = corners[k + 1] - receiver;
        if (glm::dot(a, normal) <= 0 && glm::dot(b, normal) <= 0) continue;
        if (is_upright(a, normal) || is_upright(b, normal)) continue;
        // s = x a + y b - z n with x, y, z >= 0, by Cramer's rule; the common divisor gives the sign.
        const double divisor = glm::dot(a, glm::cross(b, -normal));
        if (!(divisor != 0) || !std::isfinite(divisor)) continue;
        const double sign = divisor < 0 ? -1 : 1;
        const glm::dvec3 x = sign * glm::cross(b, -normal), y = sign * glm::cross(-normal, a),
                         z = sign * glm::cross(a, b);
        fan.planes.push_back({x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z});
    }
}

bool hidden_by(const Fan& fan, const glm::dvec3& s) {
    for (const std::array<double, 9>& p : fan.planes) {
        if (p[0] * s.x + p[1] * s.y + p[2] * s.z > 0 && p[3] * s.x + p[4] * s.y + p[5] * s.z > 0 &&
            p[6] * s.x + p[7] * s.y + p[8] * s.z > 0) {
            return true;
        }
    }
    return false;
}

TraceResult trace_transfer(const TraceScene& scene, const Assembly& all, const TraceOptions& options) {
    const auto start = std::chrono::steady_clock::now();
    const auto vertices = static_cast<uint32_t>(all.positions.size());
    TraceResult result;
    result.transfer.assign(size_t{vertices} * 25, 0.0f);
    if (options.halves) result.half[0] = result.half[1] = result.transfer;

    // Vertices at one point with one normal are one receiver.
    std::vector<uint32_t> receivers, receiver_of(vertices);
    {
        std::unordered_map<std::array<uint32_t, 4>, uint32_t,
                           decltype([](const std::array<uint32_t, 4>& key) {
                               return scramble(PointHash()({key[0], key[1], key[2]}) ^ key[3]);
                           })>
            seen;
        for (uint32_t v = 0; v < vertices; ++v) {
            const PointKey normal = key_of(all.normals[v]);
            const auto [entry, added] = seen.try_emplace({scene.point[v], normal[0], normal[1], normal[2]},
                                                         static_cast<uint32_t>(receivers.size()));
            if (added) receivers.push_back(v);
            receiver_of[v] = entry->second;
        }
    }

    const uint32_t sets = options.halves ? 2 : 1;
    const double wanted = std::max<uint32_t>(options.rays / sets, 1);
    const auto grid = 4 * std::max(1u, static_cast<uint32_t>(std::ceil(std::sqrt(wanted) / 4)));
    std::atomic<size_t> done{0};
    std::atomic<bool> cancelled{false};
    std::mutex progress_mutex;
    parallel_blocks(receivers.size(), 32, [&](size_t begin, size_t end) {
        const FlushDenormals guard;
        Scratch scratch;
        for (size_t r = begin; r < end; ++r) {
            // A receiver may be milliseconds of rays.
            if (options.cancel && options.cancel->load(std::memory_order_relaxed)) cancelled = true;
            if (cancelled) return;
            const uint32_t vertex = receivers[r];
            const glm::dvec3 position(all.positions[vertex]);
            const double length = glm::length(glm::dvec3(all.normals[vertex]));
            if (!finite(all.positions[vertex]) || !finite(all.normals[vertex]) || !(length > 0)) continue;
            const glm::dvec3 normal = glm::dvec3(all.normals[vertex]) / length;
            const uint32_t point = scene.point[vertex];
            gather_fan(scene, all, vertex, normal, scratch);

            const glm::dvec3 origin = position + normal * (options.lift * double{scene.diagonal});
            double total[25] = {};
            for (uint32_t set = 0; set < sets; ++set) {
                double sum[25] = {};
                const Random random{scramble(scramble(options.seed * 2 + set) ^ r)};
                trace_receiver(scene, origin, normal, point, grid, options, random, scratch, sum);
                for (int i = 0; i < 25; ++i) {
                    if (options.halves)
                        result.half[set][size_t{vertex} * 25 + i] = static_cast<float>(sum[i]);
                    total[i] += sum[i] / sets;
                }
            }
            for (int i = 0; i < 25; ++i)
                result.transfer[size_t{vertex} * 25 + i] = static_cast<float>(total[i]);
        }
        const size_t now = done += end - begin;
        if (options.progress && progress_mutex.try_lock()) {
            options.progress(static_cast<double>(now) / static_cast<double>(receivers.size()));
            progress_mutex.unlock();
        }
    });
    for (uint32_t v = 0; v < vertices; ++v) {
        const uint32_t source = receivers[receiver_of[v]];
        if (source == v) continue;
        for (std::vector<float>* array : {&result.transfer, &result.half[0], &result.half[1]})
            if (!array->empty()) std::memcpy(&(*array)[size_t{v} * 25], &(*array)[size_t{source} * 25], 100);
    }
    result.cancelled = cancelled;
    result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return result;
}

bool trace_blocked(const TraceScene& scene, const Assembly& all, uint32_t vertex,
                   const std::vector<glm::dvec3>& directions, std::vector<uint8_t>& blocked) {
    blocked.assign(directions.size(), 0);
    const double length = glm::length(glm::dvec3(all.normals[vertex]));
    if (!finite(all.positions[vertex]) || !finite(all.normals[vertex]) || !(length > 0)) return false;
    const FlushDenormals guard;
    Scratch scratch;
    gather_fan(scene, all, vertex, glm::dvec3(all.normals[vertex]) / length, scratch);
    const uint32_t point = scene.point[vertex];
    RayContext context;
    rtcInitIntersectContext(&context.base);
    context.incident_begin = scene.incident.data() + scene.incident_begin[point];
    context.incident_end = scene.incident.data() + scene.incident_begin[point + 1];
    context.facing = Facing::both;
    const glm::vec3& origin = all.positions[vertex];
    for (size_t k = 0; k < directions.size(); ++k) {
        if (hidden_by(scratch.fan, directions[k])) {
            blocked[k] = 1;
            continue;
        }
        const glm::vec3 s(directions[k]);
        RTCRay ray{origin.x, origin.y, origin.z, 0, s.x, s.y, s.z, 0, INFINITY, ~0u, 0, 0};
        rtcOccluded1(scene.scene.get(), &context.base, &ray);
        blocked[k] = ray.tfar < 0;
    }
    return true;
}

std::vector<float> open_transfers(const std::vector<glm::vec3>& normals) {
    std::vector<float> transfer;
    transfer.reserve(normals.size() * 25);
    for (const glm::vec3& n : normals) {
        const double length = std::sqrt(double{n.x} * n.x + double{n.y} * n.y + double{n.z} * n.z);
        double open[25] = {};
        if (length > 0 && std::isfinite(length))
            open_transfer(n.x / length, n.y / length, n.z / length, open);
        for (const double term : open)
            transfer.push_back(static_cast<float>(term));
    }
    return transfer;
}

double seen_part(const float transfer[25]) {
    return transfer[0] / 0.28209479177387814;
}

TransferError transfer_error(const std::vector<float>& ours, const std::vector<float>& reference,
                             const std::vector<uint8_t>& only) {
    TransferError error;
    std::vector<double> each;
    double all_difference = 0, all_reference = 0;
    for (size_t v = 0; v * 25 < reference.size(); ++v) {
        if (!only.empty() && !only[v]) continue;
        if (!(seen_part(&reference[v * 25]) >= 0.01)) continue;
        double difference = 0, size = 0;
        for (size_t i = v * 25; i < (v + 1) * 25; ++i) {
            const double d = static_cast<double>(ours[i]) - reference[i];
            difference += d * d;
            size += static_cast<double>(reference[i]) * reference[i];
        }
        all_difference += difference;
        all_reference += size;
        // A value of ours that is no number counts as wholly wrong instead of spoiling the sort.
        each.push_back(std::isfinite(difference) ? std::sqrt(difference / size) : INFINITY);
    }
    if (each.empty()) return error;
    std::sort(each.begin(), each.end());
    const auto quantile = [&](double q) {
        return each[std::min(each.size() - 1, static_cast<size_t>(q * static_cast<double>(each.size())))];
    };
    error.receivers = static_cast<uint32_t>(each.size());
    for (const double e : each)
        error.mean += e / static_cast<double>(each.size());
    error.median = quantile(0.5);
    error.p95 = quantile(0.95);
    error.p99 = quantile(0.99);
    error.max = each.back();
    error.pooled = std::sqrt(all_difference / all_reference);
    return error;
}

std::vector<uint8_t> clear_receivers(const std::vector<float>& reference, const std::vector<float>& lifted) {
    std::vector<uint8_t> clear(reference.size() / 25);
    for (size_t v = 0; v < clear.size(); ++v) {
        double moved = 0, size = 0;
        for (size_t i = v * 25; i < (v + 1) * 25; ++i) {
            const double d = static_cast<double>(lifted[i]) - reference[i];
            moved += d * d;
            size += static_cast<double>(reference[i]) * reference[i];
        }
        clear[v] = seen_part(&reference[v * 25]) >= 0.1 && moved < 0.01 * size;
    }
    return clear;
}

} // namespace nusselt::tools
