// Every kernel of the instruction set NUSSELT_TEST_SET, bit for bit against the scalar reference.
#include "tests/kernels/fixture.h"

#include <array>
#include <cfloat>
#include <cmath>
#include <cstdlib>
#include <cstring>

namespace nusselt::test {

using namespace kernels;

namespace {

constexpr const char* names[set_count] = {"scalar", "sse4", "avx2", "avx512", "neon"};

// What the processor says, asked another way than the library does.
bool processor_has(Set set) {
#if defined(__x86_64__)
    __builtin_cpu_init();
    switch (set) {
    case Set::scalar:
        return true;
    case Set::sse4:
        return __builtin_cpu_supports("sse4.2");
    case Set::avx2:
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
               __builtin_cpu_supports("bmi2");
    case Set::avx512:
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
               __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
               __builtin_cpu_supports("avx512cd");
    case Set::neon:
        return false;
    }
#elif defined(__aarch64__)
    if (set == Set::neon) return true;
#endif
    return set == Set::scalar;
}

TEST(Dispatch, EverySetOfTheProcessorIsThereUnderItsName) {
    for (uint32_t i = 0; i < set_count; ++i) {
        const Kernels* k = kernels_for(Set(i));
        if (!processor_has(Set(i))) {
            EXPECT_EQ(k, nullptr) << names[i];
            continue;
        }
        ASSERT_NE(k, nullptr) << names[i];
        EXPECT_STREQ(k->name, names[i]);
    }
}

TEST(Dispatch, SetsDontShareTheirKernels) {
    for (uint32_t i = 0; i < set_count; ++i) {
        for (uint32_t j = 0; j < i; ++j) {
            const Kernels *a = kernels_for(Set(i)), *b = kernels_for(Set(j));
            if (!a || !b) continue;
            EXPECT_NE(a->cluster_jobs, b->cluster_jobs) << names[i] << " " << names[j];
            EXPECT_NE(a->run_jobs, b->run_jobs);
            EXPECT_NE(a->integrate, b->integrate);
        }
    }
}

TEST(Dispatch, UnknownSetIsNull) {
    EXPECT_EQ(kernels_for(Set(4)), nullptr);
    EXPECT_EQ(kernels_for(Set(0xFFFFFFFFu)), nullptr);
}

class Sets : public testing::Test {
protected:
    void SetUp() override {
        const char* wanted = std::getenv("NUSSELT_TEST_SET");
        ASSERT_NE(wanted, nullptr) << "set NUSSELT_TEST_SET to scalar, sse4, avx2 or avx512";
        uint32_t set = 0;
        while (set < set_count && std::strcmp(names[set], wanted) != 0)
            ++set;
        ASSERT_LT(set, set_count) << wanted << " is no instruction set";
        if (!processor_has(Set(set))) GTEST_SKIP() << "SKIPPED: this processor has no " << wanted;
        k = kernels_for(Set(set));
        ASSERT_NE(k, nullptr) << "the processor has " << wanted << ", the library says no";
        ASSERT_STREQ(k->name, wanted);
        reference = kernels_for(Set::scalar);
    }

    const Kernels* k = nullptr;
    const Kernels* reference = nullptr;
};

bool same_counters(const Counters& a, const Counters& b) {
    return same_bits(&a, &b, sizeof(a));
}

// Prepared by the reference, so that a fault in prepare_batch shows in its own test alone.
BatchInput prepared(const Kernels& reference, Random& random, bool hostile) {
    BatchInput input;
    random_batch(random, hostile, random.one_in(3) ? 2.0f : 0.4f, input);
    reference.prepare_batch(input.batch, input.normal);
    return input;
}

TEST_F(Sets, PrepareBatch) {
    for (uint64_t seed = 0; seed < 4000; ++seed) {
        Random random(seed);
        BatchInput a;
        random_batch(random, seed % 2, random.between(0, 2), a);
        BatchInput b = a;
        reference->prepare_batch(a.batch, a.normal);
        k->prepare_batch(b.batch, b.normal);
        ASSERT_TRUE(same_bits(&a.batch, &b.batch, sizeof(Batch))) << "seed " << seed;
    }
}

TEST_F(Sets, SelectClusters) {
    uint64_t kept = 0, looked_at = 0;
    for (uint64_t seed = 0; seed < 3000; ++seed) {
        Random random(seed);
        const bool hostile = seed % 2;
        const BatchInput input = prepared(*reference, random, hostile);
        const uint32_t count = random.below(70);
        const size_t room = (count + 15) / 16 * 16 + 16;
        AlignedArray<float> arrays[11];
        for (auto& array : arrays)
            array = aligned_array<float>(room);
        for (uint32_t c = 0; c < room; ++c) { // past the end too: read, never used
            float axis[3];
            random.direction(axis);
            const float cosine = random.one_in(3) ? -1.0f : random.between(0, 1);
            for (uint32_t i = 0; i < 3; ++i) {
                arrays[i][c] = random.between(-1, 1);
                arrays[4 + i][c] = axis[i];
            }
            arrays[3][c] = random.between(0, 0.3f);
            arrays[7][c] = cosine;
            arrays[8][c] = std::sqrt(std::max(1 - cosine * cosine, 0.0f));
            arrays[9][c] = random.one_in(2) ? 0.0f : random.between(0, 1);
            arrays[10][c] = random.one_in(2) ? FLT_MAX : random.between(0, 2);
            if (hostile && random.one_in(8)) arrays[random.below(11)][c] = random.any_float();
            if (hostile && random.one_in(8)) {
                for (uint32_t i = 0; i < 3; ++i)
                    arrays[i][c] = input.batch.bounds.centre[i];
                arrays[3][c] = 0;
            }
        }
        const ClusterBounds bounds{{arrays[0].get(), arrays[1].get(), arrays[2].get()},
                                   arrays[3].get(),
                                   {arrays[4].get(), arrays[5].get(), arrays[6].get()},
                                   arrays[7].get(),
                                   arrays[8].get(),
                                   arrays[9].get(),
                                   arrays[10].get(),
                                   count};
        const float horizon = random.one_in(2) ? 0.0f : random.between(0, 0.3f);
        std::vector<uint32_t> candidates;
        for (uint32_t c = 0; c < count; ++c) {
            if (random.one_in(2)) candidates.push_back(c);
        }
        for (const bool listed : {false, true}) {
            const uint32_t wanted = listed ? uint32_t(candidates.size()) : count;
            auto list = aligned_array<uint32_t>(wanted + 16);
            std::copy_n(candidates.data(), listed ? wanted : 0, list.get());
            std::fill_n(list.get() + wanted, 16, 0xFFFFFFFFu); // may be read, must not be followed
            std::vector<uint32_t> a(wanted + 16), b(wanted + 16);
            uint64_t tested_a = 7, tested_b = 7;
            const uint32_t* from = listed ? list.get() : nullptr;
            const uint32_t count_a = reference->select_clusters(input.batch.bounds, bounds, from, wanted,
                                                                horizon, a.data(), &tested_a);
            const uint32_t count_b =
                k->select_clusters(input.batch.bounds, bounds, from, wanted, horizon, b.data(), &tested_b);
            ASSERT_EQ(count_a, count_b) << "seed " << seed;
            ASSERT_EQ(tested_a, tested_b) << "seed " << seed;
            a.resize(count_a);
            b.resize(count_b);
            ASSERT_EQ(a, b) << "seed " << seed;
            kept += count_a;
            looked_at += wanted;
        }
    }
    EXPECT_GT(kept, looked_at / 10); // or the inputs show nothing
    EXPECT_LT(kept, looked_at * 9 / 10);
}

TEST_F(Sets, SelectAlongAndCountCrossings) {
    uint64_t crossed = 0, met = 0;
    for (uint64_t seed = 0; seed < 4000; ++seed) {
        Random random(seed);
        const BatchInput input = prepared(*reference, random, false);
        ClusterInput cluster;
        random_cluster(random, input.batch, false, cluster);
        Rays rays{};
        std::memcpy(rays.origin, input.batch.position, sizeof(rays.origin));
        std::memcpy(rays.centre, input.batch.bounds.centre, sizeof(rays.centre));
        rays.radius = input.batch.bounds.radius;
        rays.active = random.below(0x10000);
        const uint32_t axis = random.below(4); // 3: any direction
        float direction[3] = {}, first[3];
        if (axis < 3) {
            direction[axis] = random.one_in(2) ? 1.0f : -1.0f;
        } else {
            // Towards the cluster's first corner: a ray that meets a vertex.
            const float* p = cluster.points.get() + 4 * cluster.view.vertices[0];
            const uint32_t lane = random.below(lanes);
            float square = 0;
            for (uint32_t i = 0; i < 3; ++i) {
                direction[i] = p[i] - input.batch.position[i][lane];
                square += direction[i] * direction[i];
            }
            for (float& d : direction)
                d /= std::sqrt(square);
            if (!(square > 0)) continue;
        }
        const uint32_t least = std::fabs(direction[0]) < 0.6f ? 0 : 1;
        const float along = direction[least], size = std::sqrt(1 - along * along);
        for (uint32_t i = 0; i < 3; ++i)
            first[i] = ((i == least ? 1.0f : 0.0f) - along * direction[i]) / size;
        for (uint32_t i = 0; i < 3; ++i) {
            const uint32_t m = (i + 1) % 3, n = (i + 2) % 3;
            rays.direction[i] = direction[i];
            rays.across[0][i] = first[i];
            rays.across[1][i] = direction[m] * first[n] - direction[n] * first[m];
        }
        int32_t a[lanes], b[lanes];
        for (uint32_t lane = 0; lane < lanes; ++lane)
            a[lane] = b[lane] = int32_t(lane) - 8; // added to
        EXPECT_EQ(k->triangles_along(rays, cluster.view), reference->triangles_along(rays, cluster.view));
        reference->count_crossings(rays, cluster.view, cluster.points.get(), a);
        k->count_crossings(rays, cluster.view, cluster.points.get(), b);
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            ASSERT_EQ(a[lane], b[lane]) << "seed " << seed << " lane " << lane;
            crossed += a[lane] != int32_t(lane) - 8;
        }
        constexpr uint32_t count = 40;
        AlignedArray<float> spheres[4];
        for (auto& array : spheres) {
            array = aligned_array<float>(count + 16);
            for (uint32_t i = 0; i < count + 16; ++i)
                array[i] = random.between(-1, 1);
        }
        for (uint32_t i = 0; i < count + 16; ++i)
            spheres[3][i] = std::fabs(spheres[3][i]) * 0.3f;
        ClusterBounds bounds{};
        for (uint32_t i = 0; i < 3; ++i)
            bounds.centre[i] = spheres[i].get();
        bounds.radius = spheres[3].get();
        const uint32_t begin = random.below(count), end = begin + random.below(count - begin + 1);
        std::vector<uint32_t> from_a(count + 16), from_b(count + 16);
        std::vector<uint32_t> some(count + 16, ~0u); // read past their end, never used there
        for (uint32_t i = 0; i < count; ++i)
            some[i] = random.below(count);
        const uint32_t* const candidates = random.one_in(2) ? some.data() : nullptr;
        const uint32_t count_a = reference->select_along(rays, bounds, candidates, begin, end, from_a.data());
        ASSERT_EQ(k->select_along(rays, bounds, candidates, begin, end, from_b.data()), count_a)
            << "seed " << seed;
        from_a.resize(count_a);
        from_b.resize(count_a);
        ASSERT_EQ(from_a, from_b) << "seed " << seed;
        met += count_a;
    }
    EXPECT_GT(crossed, 500u);
    EXPECT_GT(met, 1000u);
}

TEST_F(Sets, ClusterJobs) {
    for (const NamedLayout& l : layouts) {
        const float horizon = horizon_tangent(l.layout);
        uint64_t total = 0;
        for (uint64_t seed = 0; seed < 4000; ++seed) {
            Random random(seed);
            const bool hostile = seed % 2;
            const BatchInput input = prepared(*reference, random, hostile);
            ClusterInput cluster;
            random_cluster(random, input.batch, hostile, cluster);
            Jobs a(2 * jobs_per_cluster(l.layout)), b(2 * jobs_per_cluster(l.layout));
            Counters counters_a{}, counters_b{};
            auto scratch = aligned_array<ClusterScratch>(1);
            for (int round = 0; round < 2; ++round) { // the second adds to a list that has jobs
                reference->cluster_jobs(input.batch, cluster.view, cluster.points.get(), l.layout, horizon,
                                        scratch[0], a.list, counters_a);
                std::memset(static_cast<void*>(scratch.get()), 0xFF, sizeof(ClusterScratch));
                k->cluster_jobs(input.batch, cluster.view, cluster.points.get(), l.layout, horizon,
                                scratch[0], b.list, counters_b);
            }
            ASSERT_EQ(a.list.count, b.list.count) << l.name << " seed " << seed;
            ASSERT_EQ(a.sorted(), b.sorted()) << l.name << " seed " << seed;
            ASSERT_TRUE(same_counters(counters_a, counters_b)) << l.name << " seed " << seed;
            for (const auto& job : a.sorted()) {
                ASSERT_LT(job[0], lanes * mask_bytes(l.layout));
                for (uint32_t i = 1; i < 4; ++i) {
                    ASSERT_LT(job[i], plane_table_bytes(l.layout)) << l.name << " seed " << seed;
                    ASSERT_FALSE(job[i] & entry_invalid);
                }
            }
            total += a.list.count;
        }
        EXPECT_GT(total, 100000u) << l.name;
    }
}

// The receivers that look the other way, where their tangent frames are mirror images.
BatchInput turned_over(const Kernels& reference, BatchInput& front) {
    BatchInput behind = front;
    for (auto& axis : behind.normal)
        for (float& n : axis)
            n = -n;
    reference.prepare_batch(behind.batch, behind.normal);
    uint32_t mirrored = 0;
    for (uint32_t lane = 0; lane < lanes; ++lane)
        mirrored |= uint32_t(front.batch.axis[1][0][lane] == -behind.batch.axis[1][0][lane] &&
                             front.batch.axis[1][1][lane] == -behind.batch.axis[1][1][lane])
                    << lane;
    front.batch.valid &= mirrored;
    behind.batch.valid &= mirrored;
    return behind;
}

TEST_F(Sets, BothSidesJobs) {
    for (const NamedLayout& l : layouts) {
        if (l.layout.planes != PlaneMap::octahedral) continue;
        const float horizon = horizon_tangent(l.layout);
        uint64_t total = 0;
        for (uint64_t seed = 0; seed < 4000; ++seed) {
            Random random(seed);
            const bool hostile = seed % 2;
            BatchInput input = prepared(*reference, random, hostile);
            BatchInput behind = turned_over(*reference, input);
            if (random.one_in(4)) behind.batch.valid &= random.below(0x10000);
            if (random.one_in(8)) input.batch.valid = 0;
            ClusterInput cluster;
            random_cluster(random, input.batch, hostile, cluster);
            Jobs a(2 * jobs_per_cluster(l.layout)), b(2 * jobs_per_cluster(l.layout));
            Counters counters_a{}, counters_b{};
            auto scratch = aligned_array<ClusterScratch>(1);
            reference->both_sides_jobs(input.batch, behind.batch, cluster.view, cluster.points.get(),
                                       l.layout, horizon, scratch[0], a.list, counters_a);
            std::memset(static_cast<void*>(scratch.get()), 0xFF, sizeof(ClusterScratch));
            k->both_sides_jobs(input.batch, behind.batch, cluster.view, cluster.points.get(), l.layout,
                               horizon, scratch[0], b.list, counters_b);
            ASSERT_EQ(a.sorted(), b.sorted()) << l.name << " seed " << seed;
            ASSERT_TRUE(same_counters(counters_a, counters_b)) << l.name << " seed " << seed;
            total += a.list.count;
        }
        EXPECT_GT(total, 100000u) << l.name;
    }
}

TEST_F(Sets, TriangleJobs) {
    for (const NamedLayout& l : layouts) {
        uint64_t total = 0;
        for (uint64_t seed = 0; seed < 6000; ++seed) {
            Random random(seed);
            const bool hostile = seed % 2;
            const BatchInput input = prepared(*reference, random, hostile);
            alignas(64) float corners[3][3][lanes];
            const float size = std::exp(random.between(-6, 1));
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                const uint32_t kind = hostile ? random.below(16) : 16;
                for (uint32_t corner = 0; corner < 3; ++corner) {
                    for (uint32_t i = 0; i < 3; ++i)
                        corners[corner][i][lane] =
                            input.batch.position[i][lane] + random.between(-size, size);
                }
                for (uint32_t i = 0; i < 3; ++i) {
                    if (kind == 0) corners[random.below(3)][i][lane] = input.batch.position[i][lane];
                    if (kind == 1) corners[1][i][lane] = corners[0][i][lane];
                    if (kind == 2)
                        corners[1][i][lane] =
                            2 * input.batch.position[i][lane] - corners[0][i][lane]; // in line with it
                    if (kind == 3) corners[2][i][lane] = 0.5f * (corners[0][i][lane] + corners[1][i][lane]);
                    if (kind == 4) corners[random.below(3)][i][lane] = random.frame_float();
                    if (kind == 5) corners[0][i][lane] = corners[1][i][lane] = corners[2][i][lane];
                    if (kind == 6)
                        corners[2][i][lane] = 3 * input.batch.position[i][lane] - corners[0][i][lane] -
                                              corners[1][i][lane]; // the receiver inside it
                }
            }
            const uint32_t active = hostile ? uint32_t(random.engine()) & 0xFFFF : 0xFFFF;
            const uint32_t two_sided = uint32_t(random.engine()) & 0xFFFF;
            const float horizon = random.one_in(2) ? 0.0f : horizon_tangent(l.layout);
            Jobs a(4 * lanes), b(4 * lanes);
            Counters counters_a{}, counters_b{};
            reference->triangle_jobs(input.batch, corners, active, two_sided, l.layout, horizon, a.list,
                                     counters_a);
            k->triangle_jobs(input.batch, corners, active, two_sided, l.layout, horizon, b.list, counters_b);
            ASSERT_EQ(a.sorted(), b.sorted()) << l.name << " seed " << seed;
            ASSERT_TRUE(same_counters(counters_a, counters_b)) << l.name << " seed " << seed;
            total += a.list.count;
        }
        EXPECT_GT(total, 30000u) << l.name;
    }
}

TEST_F(Sets, FanJobs) {
    for (const NamedLayout& l : layouts) {
        uint64_t total = 0;
        for (uint64_t seed = 0; seed < 6000; ++seed) {
            Random random(seed);
            const bool hostile = seed % 2;
            const BatchInput input = prepared(*reference, random, hostile);
            alignas(64) float corners[2][3][lanes];
            const float size = std::exp(random.between(-8, 1));
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                const uint32_t kind = hostile ? random.below(10) : 10;
                for (uint32_t corner = 0; corner < 2; ++corner) {
                    for (uint32_t i = 0; i < 3; ++i)
                        corners[corner][i][lane] =
                            input.batch.position[i][lane] + random.between(-size, size);
                }
                for (uint32_t i = 0; i < 3; ++i) {
                    const float p = input.batch.position[i][lane];
                    if (kind == 0) corners[0][i][lane] = p;
                    if (kind == 1) corners[1][i][lane] = corners[0][i][lane];
                    if (kind == 2) corners[1][i][lane] = p + size * input.batch.axis[2][i][lane];
                    if (kind == 3) corners[0][i][lane] = p + size * input.batch.axis[0][i][lane];
                    if (kind == 4) corners[random.below(2)][i][lane] = random.frame_float();
                    if (kind == 5) corners[1][i][lane] = 2 * p - corners[0][i][lane];
                    if (kind == 6) { // beside the normal, on either side of what counts as upright
                        const float across = (lane % 2 ? 8e-5f : 1.2e-4f) * input.batch.axis[0][i][lane];
                        corners[0][i][lane] = p + size * (input.batch.axis[2][i][lane] + across);
                    }
                }
            }
            const uint32_t active = hostile ? uint32_t(random.engine()) & 0xFFFF : 0xFFFF;
            Jobs a(4 * lanes), b(4 * lanes);
            Counters counters_a{}, counters_b{};
            const uint32_t folded_a =
                reference->fan_jobs(input.batch, corners, active, l.layout, a.list, counters_a);
            const uint32_t folded_b = k->fan_jobs(input.batch, corners, active, l.layout, b.list, counters_b);
            ASSERT_EQ(folded_a, folded_b) << l.name << " seed " << seed;
            ASSERT_EQ(a.sorted(), b.sorted()) << l.name << " seed " << seed;
            ASSERT_TRUE(same_counters(counters_a, counters_b)) << l.name << " seed " << seed;
            total += a.list.count;
        }
        EXPECT_GT(total, 30000u) << l.name;
    }
}

void random_jobs(Random& random, const MaskLayout& layout, uint32_t count, JobList& list) {
    const uint32_t bytes = mask_bytes(layout);
    for (uint32_t j = 0; j < count; ++j) {
        const uint32_t part = random.below(mask_parts(layout)) * part_bytes(layout);
        for (auto& plane : list.plane) {
            plane[j] = random.below(table_cells(layout)) << cell_shift(layout);
            plane[j] += has_turned_parts(layout) ? random.below(2) : part;
        }
        list.destination[j] = random.below(lanes) * bytes + part;
    }
    list.count = count;
}

TEST_F(Sets, RunJobs) {
    for (const NamedLayout& l : layouts) {
        const Tables& tables = tables_of(l.layout);
        const size_t bytes = size_t(lanes) * mask_bytes(l.layout);
        for (uint64_t seed = 0; seed < 400; ++seed) {
            Random random(seed);
            const uint32_t count = seed < 40 ? uint32_t(seed) : random.below(700);
            Jobs a(count), b(count);
            auto masks_a = aligned_array<uint8_t>(bytes), masks_b = aligned_array<uint8_t>(bytes);
            if (seed % 2) {
                for (size_t i = 0; i < bytes; ++i)
                    masks_a[i] = masks_b[i] = uint8_t(random.engine() & random.engine());
            }
            Random same = random;
            random_jobs(random, l.layout, count, a.list);
            random_jobs(same, l.layout, count, b.list);
            reference->run_jobs(tables, a.list, masks_a.get());
            k->run_jobs(tables, b.list, masks_b.get());
            EXPECT_EQ(a.list.count, 0u);
            EXPECT_EQ(b.list.count, 0u);
            ASSERT_TRUE(same_bits(masks_a.get(), masks_b.get(), bytes)) << l.name << " seed " << seed;
        }
    }
}

// Masks of all kinds: random, blocky, empty, full, one bit.
void random_masks(Random& random, const MaskLayout& layout, uint8_t* masks) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        uint8_t* mask = masks + size_t(lane) * mask_bytes(layout);
        const uint32_t kind = random.below(6);
        for (uint32_t i = 0; i < mask_bytes(layout); i += 2) {
            uint32_t bits = kind == 0 ? 0 : kind == 1 ? 0xFFFF : uint32_t(random.engine());
            if (kind == 2) bits = random.one_in(3) ? bits : random.one_in(2) ? 0xFFFF : 0;
            if (kind == 3) bits = random.one_in(2) ? 0xFFFF : 0;
            if (kind == 4) bits = 0;
            mask[i] = uint8_t(bits);
            mask[i + 1] = uint8_t(bits >> 8);
        }
        if (kind == 4) mask[random.below(mask_bytes(layout))] = uint8_t(1u << random.below(8));
    }
}

TEST_F(Sets, Integrate) {
    for (const NamedLayout& l : layouts) {
        const Tables& tables = tables_of(l.layout);
        const size_t bytes = size_t(lanes) * mask_bytes(l.layout);
        for (uint64_t seed = 0; seed < 300; ++seed) {
            Random random(seed);
            auto masks = aligned_array<uint8_t>(bytes);
            random_masks(random, l.layout, masks.get());
            const uint32_t valid = seed % 2 ? uint32_t(random.engine()) & 0xFFFF : 0xFFFF;
            for (const bool per_block : {false, true}) {
                alignas(64) float a[25][lanes], b[25][lanes];
                Counters counters_a{}, counters_b{};
                reference->integrate(tables, masks.get(), valid, per_block, 5, a, counters_a);
                const uint32_t order = 5 - uint32_t(seed % 5); // the others: as they were
                std::memset(b, 0x22, sizeof(b));
                std::memset(a + order * order, 0x22, (25 - order * order) * sizeof(a[0]));
                k->integrate(tables, masks.get(), valid, per_block, order, b, counters_b);
                ASSERT_TRUE(same_bits(a, b, sizeof(a))) << l.name << " seed " << seed << " " << per_block;
                ASSERT_TRUE(same_counters(counters_a, counters_b)) << l.name << " seed " << seed;
            }
        }
    }
}

TEST_F(Sets, Rotate) {
    for (uint64_t seed = 0; seed < 2000; ++seed) {
        Random random(seed);
        const BatchInput input = prepared(*reference, random, seed % 2);
        alignas(64) float local[25][lanes], a[25][lanes], b[25][lanes];
        for (auto& term : local) {
            for (float& value : term)
                value = random.between(-1, 1);
        }
        reference->rotate(input.batch, 5, local, a);
        const uint32_t order = 5 - uint32_t(seed % 5);
        std::memset(b, 0x22, sizeof(b));
        std::memset(a + order * order, 0x22, (25 - order * order) * sizeof(a[0]));
        k->rotate(input.batch, order, local, b);
        ASSERT_TRUE(same_bits(a, b, sizeof(a))) << "seed " << seed;
    }
}

TEST_F(Sets, Downsample) {
    for (const NamedLayout& l : layouts) {
        for (uint64_t seed = 0; seed < 300; ++seed) {
            Random random(seed);
            auto masks = aligned_array<uint8_t>(size_t(lanes) * mask_bytes(l.layout));
            random_masks(random, l.layout, masks.get());
            uint8_t a[256], b[256];
            reference->downsample(masks.get(), mask_blocks(l.layout), a);
            k->downsample(masks.get(), mask_blocks(l.layout), b);
            ASSERT_TRUE(same_bits(a, b, mask_blocks(l.layout))) << l.name << " seed " << seed;
        }
    }
}

TEST_F(Sets, Shade) {
    for (uint64_t seed = 0; seed < 300; ++seed) {
        Random random(seed);
        const size_t count = random.below(70), stride = 100 + 4 * random.below(8);
        std::vector<float> transfer(count * stride / 4 + 1), a(3 * count + 4, -7.0f), b(3 * count + 4, -7.0f);
        for (float& value : transfer)
            value = random.between(-1, 1);
        float light[75];
        for (float& value : light)
            value = seed % 8 == 7 ? random.any_float() : random.between(-3, 3);
        bool finite = true;
        for (const float value : light)
            finite = finite && std::isfinite(value);
        const uint32_t order = 5 - uint32_t(seed % 5);
        reference->shade(light, order, transfer.data(), stride, count, a.data());
        k->shade(light, order, transfer.data(), stride, count, b.data());
        for (size_t i = 0; i < a.size(); ++i) { // one not-a-number is as good as another
            if (!finite && std::isnan(a[i]) && std::isnan(b[i])) continue;
            ASSERT_TRUE(same_bits(&a[i], &b[i], 4)) << "seed " << seed;
        }
    }
}

TEST_F(Sets, EvaluateSh) {
    for (uint64_t seed = 0; seed < 300; ++seed) {
        Random random(seed);
        const size_t count = random.below(70);
        std::vector<float> d[3], a(25 * count + 4, -7.0f), b(25 * count + 4, -7.0f);
        for (size_t i = 0; i < count; ++i) {
            float direction[3];
            random.direction(direction);
            for (uint32_t c = 0; c < 3; ++c)
                d[c].push_back(direction[c]);
        }
        reference->evaluate_sh(d[0].data(), d[1].data(), d[2].data(), count, a.data());
        k->evaluate_sh(d[0].data(), d[1].data(), d[2].data(), count, b.data());
        ASSERT_TRUE(same_bits(a.data(), b.data(), a.size() * sizeof(float))) << "seed " << seed;
    }
}

} // namespace

} // namespace nusselt::test
