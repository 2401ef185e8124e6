// The figures themselves: a planted error must move them, and nothing else may.
#include "tools/compare/figures.h"
#include "tools/compare/moment.h"
#include "tools/compare/report.h"
#include "tools/report/failure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace nusselt::tools {
namespace {

TEST(Distribution, HasItsQuantiles) {
    std::vector<double> values;
    for (int k = 1000; k > 0; --k)
        values.push_back(k / 1000.0);
    const Distribution d = distribution(values);
    EXPECT_EQ(d.count, 1000u);
    EXPECT_NEAR(d.mean, 0.5005, 1e-9);
    EXPECT_NEAR(d.median, 0.5, 0.0011);
    EXPECT_NEAR(d.p95, 0.95, 0.0011);
    EXPECT_NEAR(d.p99, 0.99, 0.0011);
    EXPECT_EQ(d.max, 1);
    EXPECT_EQ(distribution({}).count, 0u);
    // No number is the worst there is, not the best.
    EXPECT_TRUE(std::isinf(distribution({0.1, NAN}).max));
}

struct Vectors {
    std::vector<float> reference, ours;
    std::vector<uint32_t> receivers;
    std::vector<uint8_t> clear;

    explicit Vectors(uint32_t count) : reference(count * 25), clear(count, 1) {
        for (uint32_t v = 0; v < count; ++v) {
            receivers.push_back(v);
            for (uint32_t i = 0; i < 25; ++i)
                reference[v * 25 + i] = 0.25f / static_cast<float>(1 + i + v % 7);
        }
        ours = reference;
    }
    Gatherer gather(const std::vector<Light>& lights) const {
        Gatherer gatherer(lights);
        gatherer.add(0, ours, reference, receivers, clear);
        return gatherer;
    }
};

TEST(Figures, NoErrorIsZero) {
    const std::vector<Light> lights{sun_light(), gradient_light()};
    const Gatherer gatherer = Vectors(50).gather(lights);
    EXPECT_EQ(gatherer.all().each.count, 50u);
    EXPECT_EQ(gatherer.all().each.max, 0);
    EXPECT_EQ(gatherer.clear().pooled, 0);
    EXPECT_EQ(gatherer.absolute().max, 0);
    EXPECT_EQ(gatherer.ambient().max, 0);
    EXPECT_EQ(gatherer.radiance()[0].relative, 0);
}

TEST(Figures, WrongSignOfOneTermShows) {
    const std::vector<Light> lights{sun_light(), gradient_light()};
    for (uint32_t term = 0; term < 25; ++term) {
        Vectors vectors(50);
        for (uint32_t v = 0; v < 50; ++v)
            vectors.ours[v * 25 + term] *= -1;
        const Gatherer gatherer = vectors.gather(lights);
        EXPECT_GT(gatherer.all().each.mean, 0.05) << term;
        EXPECT_GT(gatherer.absolute().mean, 0.01) << term;
        EXPECT_EQ(gatherer.ambient().max > 0, term == 0) << term;
        // The gradient has light in terms 0 and 1 alone.
        EXPECT_EQ(gatherer.radiance()[1].relative > 0, term < 2) << term;
    }
}

TEST(Figures, OneWrongReceiverIsTheWorst) {
    Vectors vectors(500);
    vectors.ours[123 * 25] = 1;
    const Gatherer gatherer = vectors.gather({});
    ASSERT_EQ(gatherer.worst(3).size(), 3u);
    EXPECT_EQ(gatherer.worst(3)[0].vertex, 123u);
    EXPECT_EQ(gatherer.worst(3)[1].error, 0);
    EXPECT_EQ(gatherer.all().each.median, 0);
    EXPECT_EQ(gatherer.all().each.max, gatherer.worst(1)[0].error);
    EXPECT_GT(gatherer.all().pooled, 0);
}

TEST(Figures, ClearAndDarkAreCountedApart) {
    Vectors vectors(10);
    vectors.clear[3] = 0;
    vectors.ours[3 * 25] += 0.1f;
    for (size_t i = 0; i < 25; ++i)
        vectors.reference[5 * 25 + i] *= 1e-3f; // sees under 1 %
    const Gatherer gatherer = vectors.gather({});
    EXPECT_EQ(gatherer.all().each.count, 9u);
    EXPECT_EQ(gatherer.clear().each.count, 8u);
    EXPECT_EQ(gatherer.clear().each.max, 0);
    EXPECT_GT(gatherer.all().each.max, 0);
    // What is lit there is told by the absolute error.
    EXPECT_EQ(gatherer.absolute().count, 10u);
    EXPECT_GT(gatherer.absolute().max, 0.1);
}

TEST(Figures, ChangeIsOfTheErrorAlone) {
    Vectors a(20), b(20);
    for (float& value : b.reference)
        value *= 0.5f;
    // The same error in both frames doesn't flicker.
    b.ours = b.reference;
    for (uint32_t v = 0; v < 20; ++v) {
        a.ours[v * 25 + 2] += 0.125f;
        b.ours[v * 25 + 2] += 0.125f;
    }
    Gatherer still({});
    still.add_change(a.ours, a.reference, b.ours, b.reference, a.receivers);
    EXPECT_EQ(still.change().count, 20u);
    EXPECT_LT(still.change().max, 1e-6);
    b.ours[7 * 25 + 2] -= 0.125f;
    Gatherer flickers({});
    flickers.add_change(a.ours, a.reference, b.ours, b.reference, a.receivers);
    EXPECT_GT(flickers.change().max, 0.2);
}

TEST(Figures, HistogramHoldsEveryReceiver) {
    Vectors vectors(100);
    for (uint32_t v = 0; v < 100; ++v)
        vectors.ours[v * 25] *= 1 + 1e-6f * std::pow(10.0f, static_cast<float>(v % 9));
    uint64_t sum = 0;
    const Histogram histogram = vectors.gather({}).histogram(false);
    for (const uint64_t count : histogram)
        sum += count;
    EXPECT_EQ(sum, 100u);
}

TEST(EqualError, IsStraightInLogarithms) {
    const std::vector<CurvePoint> curve{{0.16, 1}, {0.01, 16}, {0.04, 4}};
    EXPECT_NEAR(time_at_error(curve, 0.08).time, 2, 1e-12);
    EXPECT_NEAR(time_at_error(curve, 0.02).time, 8, 1e-12);
    EXPECT_NEAR(time_at_error(curve, 0.04).time, 4, 1e-12);
    EXPECT_EQ(time_at_error(curve, 0.02).outside, Outside::no);
    EXPECT_EQ(time_at_error(curve, 0.001).outside, Outside::smaller);
    EXPECT_EQ(time_at_error(curve, 0.001).time, 16);
    EXPECT_EQ(time_at_error(curve, 0.5).outside, Outside::larger);
    EXPECT_EQ(time_at_error(curve, 0.5).time, 1);
    EXPECT_EQ(time_at_error({}, 0.5).time, 0);
}

TEST(Pareto, FrontIsUnbeaten) {
    const std::vector<bool> front = pareto_front({{0.1, 1}, {0.05, 2}, {0.06, 3}, {0.05, 4}, {0.01, 9}});
    EXPECT_EQ(front, (std::vector<bool>{true, true, false, false, true}));
}

TEST(Evenly, ChoosesRunsFromEndToEnd) {
    std::vector<uint32_t> all(1000);
    for (uint32_t k = 0; k < 1000; ++k)
        all[k] = k;
    EXPECT_EQ(evenly(all, 1000, 64), all);
    EXPECT_EQ(evenly(all, 5000, 64), all);
    const std::vector<uint32_t> single = evenly(all, 100, 1);
    ASSERT_EQ(single.size(), 100u);
    EXPECT_EQ(single.front(), 0u);
    EXPECT_EQ(single.back(), 999u);
    const std::vector<uint32_t> runs = evenly(all, 256, 64);
    ASSERT_EQ(runs.size(), 256u);
    EXPECT_TRUE(std::is_sorted(runs.begin(), runs.end()));
    EXPECT_EQ(std::adjacent_find(runs.begin(), runs.end()), runs.end());
    for (size_t k = 0; k < runs.size(); k += 64)
        EXPECT_EQ(runs[k + 63], runs[k] + 63);
    EXPECT_EQ(runs.back(), 999u);
    // Fewer than a run holds is still some.
    EXPECT_EQ(evenly(all, 10, 64).size(), 10u);
}

TEST(Summary, SetsStandardAgainstItsFloorAndThePeer) {
    Comparison comparison;
    SceneReport scene;
    scene.name = "model.glb";
    scene.receivers = 1000;
    scene.reference_receivers = 250;
    Entry ours, floor;
    ours.name = "standard";
    ours.clear.each = {200, 0.012, 0.01, 0.03, 0.05, 0.08};
    ours.us = {2, 2.5};
    ours.peer_clear = {50, Outside::no};
    ours.peer_all = {30, Outside::larger};
    floor.name = "floor 1024";
    floor.kind = Kind::floor;
    floor.clear.each.mean = 0.008;
    scene.entries = {ours, floor};
    scene.complete = true;
    comparison.scenes = {scene};
    comparison.failures = {{"bad.obj", "can't be read"}};
    const std::string text = summary_table(comparison);
    for (const char* part : {"model.glb", "250/1000", "1.20", "5.00", "8.00", "0.80", "1.50", "x   25.0",
                             "x <=15.0", "bad.obj: not measured: can't be read"})
        EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
    EXPECT_EQ(text.find("not complete"), std::string::npos);
}

TEST(Readme, TablesStandBetweenTheMarkers) {
    const std::string text = "a\n<!-- compare:begin -->\nold\n<!-- compare:end -->\nz\n";
    const std::string with = with_tables(text, "new\n", "README.md");
    EXPECT_EQ(with, "a\n<!-- compare:begin -->\nnew\n<!-- compare:end -->\nz\n");
    EXPECT_EQ(with_tables(with, "new\n", "README.md"), with);
    EXPECT_THROW(with_tables("a\n", "new\n", "README.md"), Failure);
}

} // namespace
} // namespace nusselt::tools
