// What is told about an entry's transfer vectors. Everything in double; nothing is rounded away before it is
// summed.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace nusselt::tools {

// Norm of the transfer vector of a vertex that sees the whole hemisphere.
double open_norm();

struct Distribution {
    uint64_t count = 0;
    double mean = 0, median = 0, p95 = 0, p99 = 0, max = 0;
};
// Not finite values count as infinite: they are not sorted away.
Distribution distribution(std::vector<double> values);

struct ErrorFigures {
    Distribution each;  // relative L2 error of each receiver's transfer vector
    double pooled = 0;  // root of the summed squares of the differences over that of the reference
    bool noisy = false; // the mean is no larger than the reference's own noise: not a finding
};

// Decades of relative error for histograms: bin k holds errors in [10^(low + k / per), 10^(low + (k + 1) /
// per)); the first and the last take what lies beyond.
constexpr int histogram_low = -4, histogram_per = 6, histogram_bins = 30;
using Histogram = std::array<uint64_t, histogram_bins>;

struct Light {
    std::string name;
    std::array<float, 75> terms; // [term * 3 + channel]
};
// A hard sun (a delta in direction (0.45, 0.75, 0.48), as 25 terms see it) and a soft gradient from below to
// above.
Light sun_light();
Light gradient_light();

struct RadianceError {
    double relative = 0; // root mean square of the difference over that of the reference, luminance
    double max = 0;      // largest difference over the brightest unshadowed radiance there can be
};

struct Worst {
    uint32_t frame = 0, vertex = 0;
    double error = 0, seen = 0;
    bool clear = false;
};

// Gathers receivers of all frames.
class Gatherer {
public:
    explicit Gatherer(std::vector<Light> lights) : lights_(std::move(lights)), light_sums_(lights_.size()) {}

    // Transfer vectors of 25 floats a vertex. `receivers`: the vertices that have a reference.
    void add(uint32_t frame, const std::vector<float>& ours, const std::vector<float>& reference,
             const std::vector<uint32_t>& receivers, const std::vector<uint8_t>& clear);
    // Two frames a thirtieth of a second apart: how far the error itself moves, over the reference.
    void add_change(const std::vector<float>& ours_a, const std::vector<float>& reference_a,
                    const std::vector<float>& ours_b, const std::vector<float>& reference_b,
                    const std::vector<uint32_t>& receivers);

    ErrorFigures all() const { return figures(all_); }
    ErrorFigures clear() const { return figures(clear_); }
    Distribution absolute() const { return distribution(absolute_); } // over open_norm(), dark receivers too
    Distribution ambient() const {
        return distribution(ambient_);
    } // of the cosine-weighted open part, absolute
    Distribution change() const { return distribution(change_); }
    Histogram histogram(bool clear) const;
    std::vector<RadianceError> radiance() const;
    std::vector<Worst> worst(size_t count) const;

private:
    struct Set {
        std::vector<double> each;
        double difference = 0, reference = 0;
    };
    struct LightSum {
        double difference = 0, reference = 0, max = 0;
    };
    static ErrorFigures figures(const Set& set);

    std::vector<Light> lights_;
    Set all_, clear_;
    std::vector<double> absolute_, ambient_, change_;
    std::vector<LightSum> light_sums_;
    std::vector<Worst> worst_;
};

// A point of a curve of run time against error.
struct CurvePoint {
    double error = 0, time = 0;
};
enum class Outside {
    no,
    smaller, // the error is smaller than any on the curve: the curve's time there is at least the one given
    larger   // larger than any: at most
};
struct EqualError {
    double time = 0; // of the curve at that error, straight between points in log-log
    Outside outside = Outside::no;
};
// The curve's least time among the segments that reach `error`. Points in any order, errors and times above
// 0; no points: time 0.
EqualError time_at_error(std::vector<CurvePoint> curve, double error);

// Marks points that no other beats in both: the front.
std::vector<bool> pareto_front(const std::vector<CurvePoint>& points);

} // namespace nusselt::tools
