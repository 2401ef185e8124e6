// Occlusion that fades: every instruction set against the reference, and the reference against distances.
#include "kernels/fading.h"
#include "tests/kernels/fixture.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstring>

namespace nusselt::test {

using namespace kernels;

namespace {

struct FadingList {
    Jobs jobs;
    AlignedArray<float> inverse;
    FadingJobs list;

    explicit FadingList(uint32_t capacity)
        : jobs(capacity), inverse(aligned_array<float>(3 * (size_t(capacity) + 16))) {
        const size_t stride = capacity + 16;
        list = {jobs.list, {inverse.get(), inverse.get() + stride, inverse.get() + 2 * stride}};
    }
    // Sorted, so that order does not matter; floats by their bits, and one not a number as any other.
    std::vector<std::array<uint32_t, 7>> sorted() const {
        std::vector<std::array<uint32_t, 7>> all;
        for (uint32_t j = 0; j < list.list.count; ++j) {
            std::array<uint32_t, 7> job{list.list.destination[j]};
            for (uint32_t k = 0; k < 3; ++k) {
                job[1 + k] = list.list.plane[k][j];
                std::memcpy(&job[4 + k], &list.inverse[k][j], 4);
                if (std::isnan(list.inverse[k][j])) job[4 + k] = 0x7FC00000;
            }
            all.push_back(job);
        }
        std::sort(all.begin(), all.end());
        return all;
    }
};

struct Parts {
    AlignedArray<uint8_t> bytes;
    AlignedArray<uint64_t> words;
    FadingParts list;

    explicit Parts(const MaskLayout& l)
        : bytes(aligned_array<uint8_t>(size_t(lanes) * mask_bits(l))),
          words(aligned_array<uint64_t>(lanes * mask_blocks(l) / 64)), list{bytes.get(), words.get()} {}
};

AlignedArray<float> directions_of(const MaskLayout& layout) {
    auto directions = aligned_array<float>(fade_directions_size(layout));
    build_fade_directions(layout, directions.get());
    return directions;
}

Fade random_fade(Random& random, bool hostile) {
    Fade fade;
    fade.from = random.one_in(3) ? 0.0f : random.between(0, 1);
    fade.to = random.one_in(5) ? fade.from : fade.from + random.between(0, 1);
    if (hostile && random.one_in(4)) {
        const float small = std::ldexp(1.0f, -int(random.below(140)));
        fade.from *= small;
        fade.to *= small;
    } else if (hostile && random.one_in(4)) {
        fade.to = 1e6f;
        if (random.one_in(2)) fade.from = 1e6f;
    }
    fade.steepness = std::min(1 / (fade.to - fade.from), 1e30f);
    return fade;
}

// The part that a distance hides, in sixteenths.
double part_at(double from, double to, double distance) {
    const double t = std::clamp((to - distance) / (to - from), 0.0, 1.0);
    return 16 * t * t * (3 - 2 * t);
}

// A floor of two triangles over receivers that look anywhere.
TEST(Fading, PartsFollowTheDistance) {
    const Kernels& k = *kernels_for(Set::scalar);
    for (const NamedLayout& l : layouts) {
        if (l.layout.planes != PlaneMap::octahedral) continue;
        const auto directions = directions_of(l.layout);
        const float horizon = horizon_tangent(l.layout);
        uint32_t looked_at = 0;
        for (uint64_t seed = 0; seed < 200; ++seed) {
            Random random(seed);
            BatchInput input;
            random_batch(random, false, 0.4f, input);
            k.prepare_batch(input.batch, input.normal);
            ClusterInput cluster;
            random_cluster(random, input.batch, false, cluster);
            cluster.view.nearest = cluster.view.clearance = 0;
            cluster.view.farthest = FLT_MAX;
            const Fade fade = random_fade(random, false);
            if (fade.to - fade.from < 0.05f) continue;
            Jobs whole(jobs_per_cluster(l.layout)), all(jobs_per_cluster(l.layout));
            FadingList fading(jobs_per_cluster(l.layout));
            Counters counters{};
            auto scratch = aligned_array<ClusterScratch>(1);
            k.fading_cluster_jobs(input.batch, cluster.view, cluster.points.get(), l.layout, horizon, fade,
                                  scratch[0], whole.list, fading.list, counters);
            for (uint32_t j = 0; j < fading.list.list.count; ++j) {
                // One job alone, and the samples that it covers.
                Jobs one(1);
                FadingList one_fading(1);
                for (uint32_t i = 0; i < 3; ++i) {
                    one.list.plane[i][0] = one_fading.list.list.plane[i][0] = fading.list.list.plane[i][j];
                    one_fading.list.inverse[i][0] = fading.list.inverse[i][j];
                }
                one.list.destination[0] = one_fading.list.list.destination[0] =
                    fading.list.list.destination[j];
                one.list.count = one_fading.list.list.count = 1;
                const size_t bytes = size_t(lanes) * mask_bytes(l.layout);
                auto covered = aligned_array<uint8_t>(bytes), none = aligned_array<uint8_t>(bytes);
                k.run_jobs(tables_of(l.layout), one.list, covered.get());
                Parts parts(l.layout);
                fading_kernels_for(Set::scalar)
                    ->run_jobs(tables_of(l.layout), directions.get(), fade, one_fading.list, none.get(),
                               parts.list);
                for (uint32_t sample = 0; sample < lanes * mask_bits(l.layout); ++sample) {
                    if (!(covered[sample / 8] >> sample % 8 & 1)) {
                        ASSERT_EQ(parts.bytes[sample], 0);
                        continue;
                    }
                    double d[3];
                    sample_direction(l.layout, sample % mask_bits(l.layout), d);
                    const double inverse = d[0] * double(fading.list.inverse[0][j]) +
                                           d[1] * double(fading.list.inverse[1][j]) +
                                           d[2] * double(fading.list.inverse[2][j]);
                    const double wanted =
                        inverse > 0 ? part_at(double(fade.from), double(fade.to), 1 / inverse) : 0;
                    ASSERT_NEAR(parts.bytes[sample], wanted, 0.51) << l.name << " seed " << seed;
                    ++looked_at;
                }
            }
        }
        EXPECT_GT(looked_at, 10000u);
    }
}

// The planes that jobs carry: of one triangle the corners are where it says.
TEST(Fading, JobsKnowTheirPlane) {
    const Kernels& k = *kernels_for(Set::scalar);
    uint32_t looked_at = 0;
    for (uint64_t seed = 0; seed < 300; ++seed) {
        Random random(seed);
        BatchInput input;
        random_batch(random, false, 0.4f, input);
        input.batch.valid = 1;
        k.prepare_batch(input.batch, input.normal);
        ClusterInput cluster;
        random_cluster(random, input.batch, false, cluster);
        Jobs whole(jobs_per_cluster(fine_layout));
        FadingList fading(jobs_per_cluster(fine_layout));
        Counters counters{};
        auto scratch = aligned_array<ClusterScratch>(1);
        k.fading_cluster_jobs(input.batch, cluster.view, cluster.points.get(), standard_layout,
                              horizon_tangent(standard_layout), {0, 100, 0.01f}, scratch[0], whole.list,
                              fading.list, counters);
        EXPECT_EQ(whole.list.count, 0u);
        for (uint32_t j = 0; j < fading.list.list.count; ++j) {
            double least = 1;
            for (uint32_t t = 0; t < cluster.view.triangle_count; ++t) {
                double off = 0;
                for (uint32_t corner = 0; corner < 3; ++corner) {
                    const float* p =
                        cluster.points.get() +
                        4 * size_t(cluster.view.vertices[cluster.view.triangles[8 * t + corner]]);
                    double along = 0, d[3];
                    for (uint32_t i = 0; i < 3; ++i)
                        d[i] = double(p[i]) - double(input.batch.position[i][0]);
                    for (uint32_t row = 0; row < 3; ++row) {
                        double local = 0;
                        for (uint32_t i = 0; i < 3; ++i)
                            local += double(input.batch.axis[row][i][0]) * d[i];
                        along += local * double(fading.list.inverse[row][j]);
                    }
                    off = std::max(off, std::fabs(along - 1));
                }
                least = std::min(least, off);
            }
            EXPECT_LT(least, 2e-3) << "seed " << seed;
            ++looked_at;
        }
    }
    EXPECT_GT(looked_at, 1000u);
}

// The instruction set NUSSELT_TEST_SET.
class FadingSets : public testing::Test {
protected:
    void SetUp() override {
        const std::optional<Set> set = set_to_test();
        if (!set) GTEST_SKIP() << "SKIPPED: NUSSELT_TEST_SET names no set that runs here";
        k = kernels_for(*set);
        fading = fading_kernels_for(*set);
        ASSERT_NE(k, nullptr);
        ASSERT_NE(fading, nullptr);
    }
    const Kernels* k = nullptr;
    const FadingKernels* fading = nullptr;
    const Kernels* reference = kernels_for(Set::scalar);
    const FadingKernels* fading_reference = fading_kernels_for(Set::scalar);
};

TEST_F(FadingSets, ClusterJobs) {
    for (const NamedLayout& l : layouts) {
        if (l.layout.planes != PlaneMap::octahedral) continue;
        const float horizon = horizon_tangent(l.layout);
        uint64_t whole = 0, in_part = 0;
        for (uint64_t seed = 0; seed < 4000; ++seed) {
            Random random(seed);
            const bool hostile = seed % 2;
            BatchInput input;
            random_batch(random, hostile, random.one_in(4) ? 3.0f : 0.4f, input);
            reference->prepare_batch(input.batch, input.normal);
            ClusterInput cluster;
            random_cluster(random, input.batch, hostile, cluster);
            const Fade fade = random_fade(random, hostile);
            Jobs a(2 * jobs_per_cluster(l.layout)), b(2 * jobs_per_cluster(l.layout));
            FadingList fading_a(2 * jobs_per_cluster(l.layout)), fading_b(2 * jobs_per_cluster(l.layout));
            Counters counters_a{}, counters_b{};
            auto scratch = aligned_array<ClusterScratch>(1);
            for (int round = 0; round < 2; ++round) { // the second adds to lists that have jobs
                reference->fading_cluster_jobs(input.batch, cluster.view, cluster.points.get(), l.layout,
                                               horizon, fade, scratch[0], a.list, fading_a.list, counters_a);
                std::memset(static_cast<void*>(scratch.get()), 0xFF, sizeof(ClusterScratch));
                k->fading_cluster_jobs(input.batch, cluster.view, cluster.points.get(), l.layout, horizon,
                                       fade, scratch[0], b.list, fading_b.list, counters_b);
            }
            ASSERT_EQ(a.sorted(), b.sorted()) << l.name << " seed " << seed;
            ASSERT_EQ(fading_a.sorted(), fading_b.sorted()) << l.name << " seed " << seed;
            ASSERT_TRUE(same_bits(&counters_a, &counters_b, sizeof(Counters))) << l.name << " seed " << seed;
            whole += a.list.count;
            in_part += fading_a.list.list.count;
        }
        EXPECT_GT(whole, 30000u) << l.name;
        EXPECT_GT(in_part, 30000u) << l.name;
    }
}

TEST_F(FadingSets, RunAndSplit) {
    for (const NamedLayout& l : layouts) {
        if (l.layout.planes != PlaneMap::octahedral) continue;
        const auto directions = directions_of(l.layout);
        const size_t bytes = size_t(lanes) * mask_bytes(l.layout);
        const size_t samples = size_t(lanes) * mask_bits(l.layout);
        uint64_t digits_seen = 0;
        for (uint64_t seed = 0; seed < 120; ++seed) {
            Random random(seed);
            const Fade fade = random_fade(random, seed % 2);
            const uint32_t count = random.below(80);
            FadingList list[2] = {FadingList(count), FadingList(count)};
            for (uint32_t j = 0; j < count; ++j) {
                const uint32_t part = random.below(mask_parts(l.layout)) * part_bytes(l.layout);
                float inverse[3];
                random.direction(inverse);
                for (uint32_t i = 0; i < 3; ++i) {
                    const uint32_t cell = random.below(table_cells(l.layout));
                    const uint32_t plane = (cell << cell_shift(l.layout)) + random.below(2);
                    const float value = seed % 2 && random.one_in(8) ? random.any_float()
                                                                     : inverse[i] / random.between(0, 1.5f);
                    for (FadingList& f : list) {
                        f.list.list.plane[i][j] = plane;
                        f.list.inverse[i][j] = value;
                    }
                }
                const uint32_t destination = random.below(lanes) * mask_bytes(l.layout) + part;
                for (FadingList& f : list)
                    f.list.list.destination[j] = destination;
            }
            for (FadingList& f : list)
                f.list.list.count = count;
            auto masks = aligned_array<uint8_t>(bytes);
            for (size_t i = 0; i < bytes; ++i)
                masks[i] = random.one_in(3) ? uint8_t(random.engine()) : uint8_t(0);
            AlignedArray<uint8_t> own[2] = {aligned_array<uint8_t>(5 * bytes),
                                            aligned_array<uint8_t>(5 * bytes)};
            Parts parts[2] = {Parts(l.layout), Parts(l.layout)};
            uint32_t any[2];
            for (uint32_t i = 0; i < 2; ++i) {
                const FadingKernels& kernels = i == 0 ? *fading_reference : *fading;
                kernels.run_jobs(tables_of(l.layout), directions.get(), fade, list[i].list, masks.get(),
                                 parts[i].list);
                EXPECT_EQ(list[i].list.list.count, 0u);
            }
            ASSERT_TRUE(same_bits(parts[0].bytes.get(), parts[1].bytes.get(), samples))
                << l.name << " seed " << seed;
            std::vector<uint8_t> before(parts[0].bytes.get(), parts[0].bytes.get() + samples);
            for (uint32_t i = 0; i < 2; ++i) {
                const FadingKernels& kernels = i == 0 ? *fading_reference : *fading;
                std::memcpy(own[i].get(), masks.get(), bytes);
                uint8_t* const digits[fade_digits] = {own[i].get() + bytes, own[i].get() + 2 * bytes,
                                                      own[i].get() + 3 * bytes, own[i].get() + 4 * bytes};
                any[i] = kernels.split(l.layout, parts[i].list, own[i].get(), digits);
                EXPECT_TRUE(std::all_of(parts[i].bytes.get(), parts[i].bytes.get() + samples,
                                        [](uint8_t part) { return part == 0; }));
                EXPECT_TRUE(std::all_of(parts[i].words.get(), parts[i].words.get() + samples / 1024,
                                        [](uint64_t word) { return word == 0; }));
            }
            ASSERT_EQ(any[0], any[1]);
            ASSERT_TRUE(same_bits(own[0].get(), own[1].get(), 5 * bytes)) << l.name << " seed " << seed;
            for (size_t sample = 0; sample < samples; ++sample) {
                uint32_t value = 0;
                for (uint32_t set = 0; set < 5; ++set)
                    value += (own[0][set * bytes + sample / 8] >> sample % 8 & 1u) << (4 - set);
                const bool was = masks[sample / 8] >> sample % 8 & 1;
                ASSERT_EQ(value, was ? whole_part : before[sample]);
                digits_seen += value % whole_part;
            }
        }
        EXPECT_GT(digits_seen, 10000u) << l.name;
    }
}

} // namespace

} // namespace nusselt::test
