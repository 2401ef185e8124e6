#include "tools/compare/figures.h"

#include "tools/trace/sh.h"
#include "tools/trace/trace.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace nusselt::tools {

namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();
constexpr double least_seen = 0.01;
constexpr double luminance[3] = {0.2126, 0.7152, 0.0722};
constexpr size_t most_worst = 64;

double luminance_of(const Light& light, const float* transfer) {
    double sum = 0;
    for (size_t i = 0; i < 25; ++i)
        for (size_t c = 0; c < 3; ++c)
            sum += luminance[c] * light.terms[i * 3 + c] * transfer[i];
    return sum;
}

} // namespace

double open_norm() {
    double open[25], sum = 0;
    open_transfer(0, 0, 1, open);
    for (const double term : open)
        sum += term * term;
    return std::sqrt(sum);
}

Distribution distribution(std::vector<double> values) {
    Distribution d;
    d.count = values.size();
    if (values.empty()) return d;
    for (double& value : values)
        if (!std::isfinite(value)) value = infinite;
    std::sort(values.begin(), values.end());
    const auto quantile = [&](double q) {
        return values[std::min(values.size() - 1,
                               static_cast<size_t>(q * static_cast<double>(values.size())))];
    };
    double sum = 0;
    for (const double value : values)
        sum += value;
    d.mean = sum / static_cast<double>(values.size());
    d.median = quantile(0.5);
    d.p95 = quantile(0.95);
    d.p99 = quantile(0.99);
    d.max = values.back();
    return d;
}

Light sun_light() {
    Light light{"sun", {}};
    const double length = std::sqrt(0.45 * 0.45 + 0.75 * 0.75 + 0.48 * 0.48);
    double basis[25];
    sh_basis(0.45 / length, 0.75 / length, 0.48 / length, basis);
    for (size_t i = 0; i < 25; ++i)
        for (size_t c = 0; c < 3; ++c)
            light.terms[i * 3 + c] = static_cast<float>(std::numbers::pi * basis[i]);
    return light;
}

Light gradient_light() {
    // Radiance (1 + y) / 2 in direction (x, y, z).
    Light light{"gradient", {}};
    for (size_t c = 0; c < 3; ++c) {
        light.terms[c] = static_cast<float>(0.5 * std::sqrt(4 * std::numbers::pi));
        light.terms[3 + c] = static_cast<float>(0.5 * std::sqrt(4 * std::numbers::pi / 3));
    }
    return light;
}

void Gatherer::add(uint32_t frame, const std::vector<float>& ours, const std::vector<float>& reference,
                   const std::vector<uint32_t>& receivers, const std::vector<uint8_t>& clear) {
    const double open = open_norm();
    for (const uint32_t vertex : receivers) {
        const float *a = &ours[size_t{25} * vertex], *b = &reference[size_t{25} * vertex];
        double difference = 0, size = 0;
        for (size_t i = 0; i < 25; ++i) {
            const double d = double{a[i]} - b[i];
            difference += d * d;
            size += double{b[i]} * b[i];
        }
        absolute_.push_back(std::sqrt(difference) / open);
        const double seen = seen_part(b);
        ambient_.push_back(std::abs(seen_part(a) - seen));
        for (size_t k = 0; k < lights_.size(); ++k) {
            const Light& light = lights_[k];
            const double truth = luminance_of(light, b), miss = luminance_of(light, a) - truth;
            light_sums_[k].difference += miss * miss;
            light_sums_[k].reference += truth * truth;
            light_sums_[k].max =
                std::isfinite(miss) ? std::max(light_sums_[k].max, std::abs(miss)) : infinite;
        }
        if (!(seen >= least_seen)) continue;
        const double relative = std::sqrt(difference / size);
        all_.each.push_back(relative);
        all_.difference += difference;
        all_.reference += size;
        if (clear[vertex]) {
            clear_.each.push_back(relative);
            clear_.difference += difference;
            clear_.reference += size;
        }
        worst_.push_back(
            {frame, vertex, std::isfinite(relative) ? relative : infinite, seen, clear[vertex] != 0});
    }
    const auto larger = [](const Worst& a, const Worst& b) { return a.error > b.error; };
    const size_t kept = std::min(worst_.size(), most_worst);
    std::partial_sort(worst_.begin(), worst_.begin() + static_cast<std::ptrdiff_t>(kept), worst_.end(),
                      larger);
    worst_.resize(kept);
}

void Gatherer::add_change(const std::vector<float>& ours_a, const std::vector<float>& reference_a,
                          const std::vector<float>& ours_b, const std::vector<float>& reference_b,
                          const std::vector<uint32_t>& receivers) {
    for (const uint32_t vertex : receivers) {
        const size_t first = size_t{25} * vertex;
        if (!(seen_part(&reference_a[first]) >= least_seen) ||
            !(seen_part(&reference_b[first]) >= least_seen))
            continue;
        double moved = 0, size = 0;
        for (size_t i = first; i < first + 25; ++i) {
            const double d = (double{ours_b[i]} - reference_b[i]) - (double{ours_a[i]} - reference_a[i]);
            moved += d * d;
            size += double{reference_b[i]} * reference_b[i];
        }
        change_.push_back(std::sqrt(moved / size));
    }
}

ErrorFigures Gatherer::figures(const Set& set) {
    ErrorFigures figures;
    figures.each = distribution(set.each);
    figures.pooled = set.reference > 0 ? std::sqrt(set.difference / set.reference) : 0;
    return figures;
}

Histogram Gatherer::histogram(bool clear) const {
    Histogram bins{};
    for (const double error : (clear ? clear_ : all_).each) {
        const double place = (std::log10(std::max(error, 1e-300)) - histogram_low) * histogram_per;
        ++bins[static_cast<size_t>(std::clamp(place, 0.0, double{histogram_bins - 1}))];
    }
    return bins;
}

std::vector<RadianceError> Gatherer::radiance() const {
    std::vector<RadianceError> errors;
    for (size_t k = 0; k < lights_.size(); ++k) {
        const LightSum& sum = light_sums_[k];
        // The brightest that an unshadowed vertex gets, over normals.
        double brightest = 0;
        for (int j = 0; j < 400; ++j) {
            const double z = 1 - 2 * (j + 0.5) / 400, r = std::sqrt(1 - z * z), p = 2.39996322972865332 * j;
            double open[25];
            float narrow[25];
            open_transfer(r * std::cos(p), r * std::sin(p), z, open);
            std::copy(open, open + 25, narrow);
            brightest = std::max(brightest, luminance_of(lights_[k], narrow));
        }
        errors.push_back({sum.reference > 0 ? std::sqrt(sum.difference / sum.reference) : 0,
                          brightest > 0 ? sum.max / brightest : 0});
    }
    return errors;
}

std::vector<Worst> Gatherer::worst(size_t count) const {
    return {worst_.begin(), worst_.begin() + static_cast<std::ptrdiff_t>(std::min(count, worst_.size()))};
}

EqualError time_at_error(std::vector<CurvePoint> curve, double error) {
    EqualError result;
    if (curve.empty() || !(error > 0)) return result;
    std::sort(curve.begin(), curve.end(),
              [](const CurvePoint& a, const CurvePoint& b) { return a.time < b.time; });
    double least = infinite, largest = 0, time_least = 0;
    for (const CurvePoint& point : curve) {
        largest = std::max(largest, point.error);
        if (point.error < least) {
            least = point.error;
            time_least = point.time;
        }
    }
    if (error >= largest) return {curve.front().time, error > largest ? Outside::larger : Outside::no};
    if (error < least) return {time_least, Outside::smaller};
    result.time = infinite;
    for (size_t k = 0; k + 1 < curve.size(); ++k) {
        const CurvePoint &a = curve[k], &b = curve[k + 1];
        const double low = std::min(a.error, b.error), high = std::max(a.error, b.error);
        if (error < low || error > high) continue;
        const double share =
            high > low ? (std::log(error) - std::log(a.error)) / (std::log(b.error) - std::log(a.error)) : 0;
        result.time =
            std::min(result.time, std::exp(std::log(a.time) + share * (std::log(b.time) - std::log(a.time))));
    }
    return result;
}

std::vector<bool> pareto_front(const std::vector<CurvePoint>& points) {
    std::vector<bool> front(points.size(), true);
    for (size_t a = 0; a < points.size(); ++a) {
        for (const CurvePoint& b : points) {
            const bool no_worse = b.error <= points[a].error && b.time <= points[a].time;
            const bool better = b.error < points[a].error || b.time < points[a].time;
            if (no_worse && better) front[a] = false;
        }
    }
    return front;
}

} // namespace nusselt::tools
