#include "tools/compare/moment.h"

#include "tools/compare/peer.h"
#include "tools/report/stop.h"
#include "tools/trace/trace.h"

#include <glm/vec3.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace nusselt::tools {

namespace {

constexpr double frame_step = 1.0 / 30; // between a moment and the one that follows, seconds

} // namespace

std::vector<Moment> make_moments(const scenes::Scene& scene, uint32_t count) {
    std::vector<Moment> moments;
    const bool moves = scene.duration > 0;
    for (uint32_t k = 0; k < (moves ? count : 1); ++k) {
        const double time = scene.duration * (k + 0.5) / count;
        const double step = std::min(frame_step, scene.duration / (2.0 * count));
        for (int second = 0; second <= (moves ? 1 : 0); ++second) {
            Moment moment;
            moment.time = time + second * step;
            moment.follows = second == 1;
            scene.pose(moment.time, moment.pose);
            moment.all = assemble(scene, moment.pose);
            moment.receivers = distinct_receivers(moment.all);
            moments.push_back(std::move(moment));
        }
    }
    return moments;
}

std::vector<uint32_t> evenly(const std::vector<uint32_t>& all, size_t most, size_t run) {
    if (most >= all.size()) return all;
    const size_t runs = std::max<size_t>(most / run, 1);
    std::vector<uint32_t> chosen;
    for (size_t k = 0; k < runs; ++k) {
        const size_t begin = k * (all.size() - std::min(run, all.size())) / std::max<size_t>(runs - 1, 1);
        for (size_t i = begin; i < std::min(begin + run, all.size()) && chosen.size() < most; ++i)
            chosen.push_back(all[i]);
    }
    return chosen;
}

bool trace_reference(Moment& moment, const std::vector<uint32_t>& wanted, uint32_t rays, uint64_t seed,
                     const std::function<void(double)>& show) {
    // A receiver without a normal is left out by the tracer.
    Assembly only = moment.all;
    std::vector<uint8_t> is_wanted(only.positions.size());
    for (const uint32_t vertex : wanted)
        is_wanted[vertex] = 1;
    for (size_t v = 0; v < is_wanted.size(); ++v)
        if (!is_wanted[v]) only.normals[v] = glm::vec3(0);

    const TraceScene scene = make_trace_scene(moment.all);
    TraceOptions trace;
    trace.rays = rays;
    trace.halves = true;
    trace.seed = seed;
    trace.cancel = &interrupted();
    const double share = moment.follows ? 1 : 0.8;
    trace.progress = [&](double done) { show(share * done); };
    TraceResult result = trace_transfer(scene, only, trace);
    if (result.cancelled) return false;
    if (!moment.follows) {
        trace.halves = false;
        trace.rays = std::max(rays / 4, 1024u);
        trace.lift = clear_lift;
        trace.progress = [&](double done) { show(share + (1 - share) * done); };
        const TraceResult lifted = trace_transfer(scene, only, trace);
        if (lifted.cancelled) return false;
        moment.clear = clear_receivers(result.transfer, lifted.transfer);
    }
    moment.traced = wanted;
    moment.reference = std::move(result.transfer);
    moment.half[0] = std::move(result.half[0]);
    moment.half[1] = std::move(result.half[1]);
    return true;
}

Noise reference_noise(const std::vector<Moment>& moments) {
    Noise noise;
    std::vector<double> all, clear;
    for (const Moment& moment : moments) {
        if (moment.follows) continue;
        for (const uint32_t vertex : moment.traced) {
            if (!(seen_part(&moment.reference[size_t{25} * vertex]) >= 0.01)) {
                ++noise.dark;
                continue;
            }
            // The noise of the mean of two halves is half their difference.
            double difference = 0, size = 0;
            for (size_t i = size_t{25} * vertex; i < size_t{25} * vertex + 25; ++i) {
                const double d = (double{moment.half[0][i]} - moment.half[1][i]) / 2;
                difference += d * d;
                size += double{moment.reference[i]} * moment.reference[i];
            }
            all.push_back(std::sqrt(difference / size));
            if (moment.clear[vertex]) clear.push_back(all.back());
        }
    }
    noise.all = distribution(std::move(all));
    noise.clear = distribution(std::move(clear));
    // Two references that differ by chance alone.
    noise.change = noise.all.mean * std::sqrt(2.0);
    return noise;
}

} // namespace nusselt::tools
