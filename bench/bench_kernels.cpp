// Every kernel on every instruction set, on the inputs of a real frame, verified against the scalar reference
// before it is timed. Names: kernel/variant/instruction set.
#include "bench/instructions.h"
#include "bench/machine.h"
#include "bench/program.h"
#include "bench/recording.h"
#include "kernels/fading.h"
#include "kernels/light.h"
#include "kernels/outputs.h"
#include "nusselt/version.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <map>
#include <string>

namespace nusselt::bench {
namespace {

using namespace kernels;
using benchmark::State;

constexpr float horizon_of_all = -1; // culls nothing by elevation

void share(State& state, const char* name, double amount, double peak) {
    // A rate over a peak: benchmark divides by the time.
    state.counters[name] = benchmark::Counter(amount / peak, benchmark::Counter::kIsRate);
}

// One pass over all inputs.
struct Pass {
    size_t inputs = 0;
    std::function<void(size_t)> run;     // the kernel on one input
    std::function<double(size_t)> items; // of one input
    double bytes_per_item = 0, flops_per_item = 0;
    size_t working_set = 0; // of the table that is looked up; 0: none
};

// What is running, and how many instructions an item takes of what has run. The library calls a body four or
// five times, until its time is long enough: instructions are counted the first time.
std::string running;
std::map<std::string, double> counted_instructions;

double count_once(const Pass& pass) {
    const auto [known, is_new] = counted_instructions.try_emplace(running, 0);
    if (is_new) known->second = instructions_per_item(pass.inputs, pass.run, pass.items);
    return known->second;
}

// Times the passes, then tells them against what the machine can do.
void replay(State& state, const Kernels& k, const Pass& pass) {
    for (auto _ : state) {
        for (size_t i = 0; i < pass.inputs; ++i)
            pass.run(i);
        benchmark::ClobberMemory();
    }
    double items = 0;
    for (size_t i = 0; i < pass.inputs; ++i)
        items += pass.items(i);
    items *= static_cast<double>(state.iterations());
    state.SetItemsProcessed(static_cast<int64_t>(items));
    const double bytes = items * pass.bytes_per_item, flops = items * pass.flops_per_item;
    if (bytes > 0) state.SetBytesProcessed(static_cast<int64_t>(bytes));
    if (pass.working_set > 0) {
        share(state, "of_load_peak", bytes, load_peak(pass.working_set));
        share(state, "of_gather_peak", bytes, gather_peak(pass.working_set));
    }
    if (flops > 0) {
        state.counters["flops"] = benchmark::Counter(flops, benchmark::Counter::kIsRate);
        share(state, "of_flop_peak", flops, flop_peak());
    }
    // The reference is there to be right, not to be fast.
    if (&k == kernels_for(Set::scalar)) return;
    const double each = count_once(pass);
    if (each > 0) state.counters["instructions_per_item"] = each;
    if (each > 0 && issue_peak() > 0) share(state, "of_issue_peak", items * each, issue_peak());
}

double one(size_t) {
    return 1;
}
double of_batch(size_t) {
    return lanes;
}

template<class T>
bool same(const T* a, const T* b, size_t count) {
    return std::memcmp(a, b, count * sizeof(T)) == 0;
}

const char* wrong = "differs from the scalar reference";

void prepare(State& state, const Kernels& k, Recording& r) {
    Aligned<Batch> ours = r.unprepared, theirs = r.unprepared;
    for (size_t b = 0; b < ours.size(); ++b) {
        k.prepare_batch(ours[b], r.normals[b].values);
        kernels_for(Set::scalar)->prepare_batch(theirs[b], r.normals[b].values);
        if (!same(&ours[b].axis, &theirs[b].axis, 1) || !same(&ours[b].bounds, &theirs[b].bounds, 1))
            return state.SkipWithError(wrong);
    }
    const auto once = [&](size_t b) {
        ours[b].valid = 0xFFFF;
        k.prepare_batch(ours[b], r.normals[b].values);
    };
    replay(state, k, {.inputs = ours.size(), .run = once, .items = of_batch});
}

void select(State& state, const Kernels& k, Recording& r) {
    const uint32_t clusters = r.frame->cluster_count;
    std::vector<uint32_t> ours(clusters + 16), theirs(clusters + 16);
    uint64_t tested = 0;
    const auto run = [&](const Kernels& kernels, size_t b, std::vector<uint32_t>& out) {
        return kernels.select_clusters(r.batches[b].bounds, r.frame->cluster_bounds, nullptr, clusters,
                                       r.tables->horizon, out.data(), &tested);
    };
    for (size_t b = 0; b < r.batches.size(); ++b) {
        const uint32_t count = run(k, b, ours);
        if (count != run(*kernels_for(Set::scalar), b, theirs) || !same(ours.data(), theirs.data(), count))
            return state.SkipWithError(wrong);
    }
    const auto once = [&](size_t b) {
        uint32_t count = run(k, b, ours);
        benchmark::DoNotOptimize(count);
    };
    replay(state, k, {.inputs = r.batches.size(), .run = once, .items = [&](size_t) { return clusters; }});
}

// Jobs in the order of their numbers: instruction sets may make them in different orders.
std::vector<std::array<uint32_t, 4>> sorted(const JobList& list) {
    std::vector<std::array<uint32_t, 4>> jobs;
    for (uint32_t j = 0; j < list.count; ++j)
        jobs.push_back({list.destination[j], list.plane[0][j], list.plane[1][j], list.plane[2][j]});
    std::sort(jobs.begin(), jobs.end());
    return jobs;
}

constexpr size_t most_jobs = 2 * jobs_per_cluster(fine_layout) + 64; // of a cluster, for both sides

// `make` appends to a list; compares the jobs of both tables for every input.
bool same_jobs(const Kernels& k, size_t inputs,
               const std::function<void(const Kernels&, size_t, JobList&)>& make) {
    Jobs ours, theirs;
    ours.reserve(most_jobs);
    theirs.reserve(most_jobs);
    for (size_t i = 0; i < inputs; ++i) {
        JobList a = ours.list(), b = theirs.list();
        make(k, i, a);
        make(*kernels_for(Set::scalar), i, b);
        if (sorted(a) != sorted(b)) return false;
    }
    return true;
}

void time_jobs(State& state, const Kernels& k, size_t inputs, const std::function<double(size_t)>& items,
               const std::function<void(const Kernels&, size_t, JobList&)>& make) {
    if (!same_jobs(k, inputs, make)) return state.SkipWithError(wrong);
    Jobs out;
    out.reserve(most_jobs);
    double made = 0, all = 0;
    for (size_t i = 0; i < inputs; ++i) {
        JobList list = out.list();
        make(k, i, list);
        made += list.count;
        all += items(i);
    }
    const auto once = [&](size_t i) {
        JobList list = out.list();
        make(k, i, list);
        benchmark::DoNotOptimize(list.count);
    };
    replay(state, k, {.inputs = inputs, .run = once, .items = items});
    state.counters["jobs_per_item"] = made / all;
}

void clusters(State& state, const Kernels& k, Recording& r) {
    const float* points = r.frame->points.data() + 4 * size_t(r.frame->meshes[0].first_point);
    const auto scratch = std::make_unique<ClusterScratch>();
    Counters counters{};
    const auto triangles = [&](size_t i) {
        return double(r.frame->views[r.pairs[i].cluster].triangle_count) * lanes;
    };
    time_jobs(state, k, r.pairs.size(), triangles, [&](const Kernels& kernels, size_t i, JobList& list) {
        kernels.cluster_jobs(r.batches[r.pairs[i].batch], r.frame->views[r.pairs[i].cluster], points,
                             r.tables->layout, r.tables->horizon, *scratch, list, counters);
    });
}

Set set_of(const Kernels& k) {
    uint32_t set = 0;
    while (kernels_for(Set(set)) != &k)
        ++set;
    return Set(set);
}

// A fade in the midst of a hand, where most triangles are hidden in part: what is dearest.
constexpr Fade midst{0.1f, 0.3f, 5};

struct FadingList {
    Jobs jobs;
    Aligned<float> inverse[3];
    FadingJobs list() { return {jobs.list(), {inverse[0].data(), inverse[1].data(), inverse[2].data()}}; }
    void reserve(size_t capacity) {
        jobs.reserve(capacity);
        for (Aligned<float>& row : inverse)
            row.resize(capacity + 16);
    }
};

// As `sorted` of a JobList, with the floats by their bits.
std::vector<std::array<uint32_t, 7>> sorted(const FadingJobs& jobs) {
    std::vector<std::array<uint32_t, 7>> all;
    for (uint32_t j = 0; j < jobs.list.count; ++j) {
        std::array<uint32_t, 7> job{jobs.list.destination[j], jobs.list.plane[0][j], jobs.list.plane[1][j],
                                    jobs.list.plane[2][j]};
        for (size_t i = 0; i < 3; ++i)
            std::memcpy(&job[4 + i], &jobs.inverse[i][j], 4);
        all.push_back(job);
    }
    std::sort(all.begin(), all.end());
    return all;
}

void fading_clusters(State& state, const Kernels& k, Recording& r) {
    const float* points = r.frame->points.data() + 4 * size_t(r.frame->meshes[0].first_point);
    const auto scratch = std::make_unique<ClusterScratch>();
    Counters counters{};
    FadingList out[2];
    for (FadingList& list : out)
        list.reserve(jobs_per_cluster(fine_layout) + 64);
    const auto triangles = [&](size_t i) {
        return double(r.frame->views[r.pairs[i].cluster].triangle_count) * lanes;
    };
    // Returns the jobs in part; those as a whole are added to `list`.
    const auto run = [&](const Kernels& kernels, size_t i, JobList& list, FadingList& into) {
        FadingJobs fading = into.list();
        kernels.fading_cluster_jobs(r.batches[r.pairs[i].batch], r.frame->views[r.pairs[i].cluster], points,
                                    r.tables->layout, r.tables->horizon, midst, *scratch, list, fading,
                                    counters);
        return fading;
    };
    uint64_t in_part = 0;
    Jobs whole;
    whole.reserve(most_jobs);
    for (size_t i = 0; i < r.pairs.size(); ++i) {
        JobList ignored = whole.list(), too = whole.list();
        const FadingJobs ours = run(k, i, ignored, out[0]),
                         theirs = run(*kernels_for(Set::scalar), i, too, out[1]);
        if (sorted(ours) != sorted(theirs)) return state.SkipWithError(wrong);
        in_part += ours.list.count;
    }
    if (in_part == 0) return state.SkipWithError("nothing fades");
    time_jobs(state, k, r.pairs.size(), triangles, [&](const Kernels& kernels, size_t i, JobList& list) {
        benchmark::DoNotOptimize(run(kernels, i, list, out[0]).list.count);
    });
}

void run_fading(State& state, const Kernels& k, Recording& r) {
    const Tables& tables = *r.tables;
    const Kernels& scalar = *kernels_for(Set::scalar);
    const FadingKernels& ours = *fading_kernels_for(set_of(k));
    const float* points = r.frame->points.data() + 4 * size_t(r.frame->meshes[0].first_point);
    const auto scratch = std::make_unique<ClusterScratch>();
    Counters counters{};
    std::vector<FadingList> lists(r.pairs.size());
    Jobs whole;
    whole.reserve(jobs_per_cluster(fine_layout) + 64);
    Aligned<float> directions(fade_directions_size(tables.layout));
    build_fade_directions(tables.layout, directions.data());
    const size_t samples = size_t{lanes} * mask_bits(tables.layout);
    Aligned<uint8_t> bytes[2] = {Aligned<uint8_t>(samples), Aligned<uint8_t>(samples)};
    Aligned<uint64_t> words[2] = {Aligned<uint64_t>(samples / 1024), Aligned<uint64_t>(samples / 1024)};
    const Aligned<uint8_t> masks(samples / 8);
    for (size_t i = 0; i < lists.size(); ++i) {
        lists[i].reserve(jobs_per_cluster(fine_layout) + 64);
        JobList unused = whole.list();
        FadingJobs fading = lists[i].list();
        scalar.fading_cluster_jobs(r.batches[r.pairs[i].batch], r.frame->views[r.pairs[i].cluster], points,
                                   tables.layout, tables.horizon, midst, *scratch, unused, fading, counters);
        lists[i].jobs.count = fading.list.count;
        for (uint32_t which = 0; which < 2; ++which) {
            FadingParts parts{bytes[which].data(), words[which].data()};
            FadingJobs again = lists[i].list();
            (which ? *fading_kernels_for(Set::scalar) : ours)
                .run_jobs(tables, directions.data(), midst, again, masks.data(), parts);
        }
        if (!same(bytes[0].data(), bytes[1].data(), samples)) return state.SkipWithError(wrong);
    }
    const auto once = [&](size_t i) {
        FadingParts parts{bytes[0].data(), words[0].data()};
        FadingJobs again = lists[i].list();
        ours.run_jobs(tables, directions.data(), midst, again, masks.data(), parts);
    };
    replay(state, k,
           {.inputs = lists.size(), .run = once, .items = [&](size_t i) { return lists[i].jobs.count; }});
}

// What fades of a recorded batch, as digits. It ends with its input all zero, which is copied anew each time:
// that is timed with it.
void split_parts(State& state, const Kernels& k, Recording& r) {
    const Tables& tables = *r.tables;
    const Kernels& scalar = *kernels_for(Set::scalar);
    const FadingKernels *const ours = fading_kernels_for(set_of(k)), *const theirs =
                                                                         fading_kernels_for(Set::scalar);
    const float* points = r.frame->points.data() + 4 * size_t(r.frame->meshes[0].first_point);
    const auto scratch = std::make_unique<ClusterScratch>();
    Counters counters{};
    Jobs whole;
    whole.reserve(jobs_per_cluster(fine_layout) + 64);
    FadingList list;
    list.reserve(jobs_per_cluster(fine_layout) + 64);
    Aligned<float> directions(fade_directions_size(tables.layout));
    build_fade_directions(tables.layout, directions.data());
    const size_t samples = size_t{lanes} * mask_bits(tables.layout), bytes = samples / 8,
                 words = samples / 1024;
    struct Input {
        Aligned<uint8_t> parts, masks;
        Aligned<uint64_t> touched;
    };
    std::vector<Input> inputs(r.batches.size());
    for (Input& in : inputs)
        in = {Aligned<uint8_t>(samples), Aligned<uint8_t>(bytes), Aligned<uint64_t>(words)};
    for (const Pair& pair : r.pairs) {
        Input& in = inputs[pair.batch];
        JobList before = whole.list();
        FadingJobs fading = list.list();
        scalar.fading_cluster_jobs(r.batches[pair.batch], r.frame->views[pair.cluster], points, tables.layout,
                                   tables.horizon, midst, *scratch, before, fading, counters);
        scalar.run_jobs(tables, before, in.masks.data());
        FadingParts parts{in.parts.data(), in.touched.data()};
        theirs->run_jobs(tables, directions.data(), midst, fading, in.masks.data(), parts);
    }
    // Masks, then the digits of each.
    Aligned<uint8_t> parts(samples),
        out[2] = {Aligned<uint8_t>((1 + fade_digits) * bytes), Aligned<uint8_t>((1 + fade_digits) * bytes)};
    Aligned<uint64_t> touched(words);
    const auto run = [&](const FadingKernels& kernels, const Input& in, Aligned<uint8_t>& to) {
        std::copy(in.parts.begin(), in.parts.end(), parts.begin());
        std::copy(in.touched.begin(), in.touched.end(), touched.begin());
        std::copy(in.masks.begin(), in.masks.end(), to.begin());
        uint8_t* digits[fade_digits];
        for (uint32_t digit = 0; digit < fade_digits; ++digit)
            digits[digit] = to.data() + (1 + digit) * bytes;
        FadingParts all{parts.data(), touched.data()};
        return kernels.split(tables.layout, all, to.data(), digits);
    };
    uint32_t any = 0;
    for (const Input& in : inputs) {
        for (Aligned<uint8_t>& to : out)
            std::fill(to.begin(), to.end(), uint8_t(0));
        const uint32_t lanes_of_ours = run(*ours, in, out[0]);
        const bool emptied =
            std::all_of(parts.begin(), parts.end(), [](uint8_t part) { return part == 0; }) &&
            std::all_of(touched.begin(), touched.end(), [](uint64_t word) { return word == 0; });
        if (lanes_of_ours != run(*theirs, in, out[1]) || !emptied ||
            !same(out[0].data(), out[1].data(), out[0].size()))
            return state.SkipWithError(wrong);
        any |= lanes_of_ours;
    }
    if (any == 0) return state.SkipWithError("nothing fades");
    const auto once = [&](size_t i) {
        uint32_t fading = run(*ours, inputs[i], out[0]);
        benchmark::DoNotOptimize(fading);
    };
    replay(state, k, {.inputs = inputs.size(), .run = once, .items = of_batch});
}

// The recorded receivers, and the same ones that look behind; without those whose normal is along z.
struct Sides {
    Aligned<Batch> front, behind;
    std::vector<Pair> pairs; // as recorded of the front

    Sides(const Kernels& k, const Recording& r) : front(r.unprepared), behind(r.unprepared) {
        for (size_t b = 0; b < front.size(); ++b) {
            Normals turned = r.normals[b];
            uint32_t valid = front[b].valid;
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                if (turned.values[0][lane] == 0 && turned.values[1][lane] == 0) valid &= ~(1u << lane);
                for (float(&axis)[lanes] : turned.values)
                    axis[lane] = -axis[lane];
            }
            front[b].valid = behind[b].valid = valid;
            k.prepare_batch(front[b], r.normals[b].values);
            k.prepare_batch(behind[b], turned.values);
        }
        pairs = r.pairs;
    }
};

// `at_once`: blockers are looked at once for both, else once a side.
void both_sides(State& state, const Kernels& k, Recording& r, bool at_once) {
    const Sides sides(k, r);
    const float* points = r.frame->points.data() + 4 * size_t(r.frame->meshes[0].first_point);
    const auto scratch = std::make_unique<ClusterScratch>();
    Counters counters{};
    const auto triangles = [&](size_t i) {
        return 2.0 * r.frame->views[sides.pairs[i].cluster].triangle_count * lanes;
    };
    const uint32_t masks = lanes * mask_bytes(r.tables->layout);
    time_jobs(state, k, sides.pairs.size(), triangles, [&](const Kernels& kernels, size_t i, JobList& list) {
        const Batch &front = sides.front[sides.pairs[i].batch], &behind = sides.behind[sides.pairs[i].batch];
        const ClusterView& cluster = r.frame->views[sides.pairs[i].cluster];
        if (at_once) {
            kernels.both_sides_jobs(front, behind, cluster, points, r.tables->layout, r.tables->horizon,
                                    *scratch, list, counters);
            return;
        }
        kernels.cluster_jobs(front, cluster, points, r.tables->layout, r.tables->horizon, *scratch, list,
                             counters);
        const uint32_t first = list.count;
        kernels.cluster_jobs(behind, cluster, points, r.tables->layout, r.tables->horizon, *scratch, list,
                             counters);
        for (uint32_t j = first; j < list.count; ++j)
            list.destination[j] += masks;
    });
}

void triangles(State& state, const Kernels& k, Recording& r) {
    Counters counters{};
    const auto items = [&](size_t i) { return __builtin_popcount(r.triangles[i].active); };
    time_jobs(state, k, r.triangles.size(), items, [&](const Kernels& kernels, size_t i, JobList& list) {
        const TriangleCorners& t = r.triangles[i];
        kernels.triangle_jobs(r.batches[t.batch], t.values, t.active, t.two_sided, r.tables->layout,
                              horizon_of_all, list, counters);
    });
}

void fans(State& state, const Kernels& k, Recording& r) {
    Counters counters{};
    const auto items = [&](size_t i) { return __builtin_popcount(r.fans[i].active); };
    time_jobs(state, k, r.fans.size(), items, [&](const Kernels& kernels, size_t i, JobList& list) {
        const FanCorners& fan = r.fans[i];
        kernels.fan_jobs(r.batches[fan.batch], fan.values, fan.active, r.tables->layout, list, counters);
    });
}

void run_lists(State& state, const Kernels& k, const Tables& tables, std::vector<Jobs>& jobs) {
    Aligned<uint8_t> ours(size_t{lanes} * mask_bytes(tables.layout)), theirs = ours;
    for (Jobs& list : jobs) {
        JobList a = list.list(), b = list.list();
        k.run_jobs(tables, a, ours.data());
        kernels_for(Set::scalar)->run_jobs(tables, b, theirs.data());
        if (!same(ours.data(), theirs.data(), ours.size())) return state.SkipWithError(wrong);
    }
    // In parts, as a frame carries them out whenever some have gathered.
    constexpr uint32_t part = 64;
    std::vector<JobList> parts;
    for (Jobs& list : jobs) {
        const JobList all = list.list();
        for (uint32_t begin = 0; begin < all.count; begin += part)
            parts.push_back({{all.plane[0] + begin, all.plane[1] + begin, all.plane[2] + begin},
                             all.destination + begin,
                             std::min(part, all.count - begin)});
    }
    const auto once = [&](size_t i) {
        JobList list = parts[i];
        k.run_jobs(tables, list, ours.data());
    };
    // Three entries and the mask are read.
    replay(state, k,
           {.inputs = parts.size(),
            .run = once,
            .items = [&](size_t i) { return parts[i].count; },
            .bytes_per_item = 4.0 * part_bytes(tables.layout),
            .working_set = plane_table_bytes(tables.layout)});
}

// Planes all over the table, so that its size is the working set: 16 KB is in the first-level cache, 256 KB
// and 1 MB in the second, 4 MB in the third on most machines.
void run_random(State& state, const Kernels& k, uint32_t cells) {
    const MaskLayout layout{SampleMap::scattered, PlaneMap::octahedral, 32, cells};
    Aligned<uint8_t> planes(plane_table_bytes(layout));
    build_plane_table(layout, 0, table_cells(layout), planes.data());
    Tables tables;
    tables.layout = layout;
    tables.planes = planes.data();
    std::vector<Jobs> jobs(64);
    uint64_t random = 7;
    const auto next = [&random] {
        random = random * 6364136223846793005u + 1442695040888963407u;
        return static_cast<uint32_t>(random >> 33);
    };
    for (Jobs& list : jobs) {
        list.reserve(512);
        list.count = 512;
        for (uint32_t j = 0; j < 512; ++j) {
            const uint32_t offset = (next() & 1) * (mask_bytes(layout) / 2);
            for (auto& plane : list.plane)
                plane[j] = next() % table_cells(layout) * cell_bytes(layout) | (next() & 1);
            list.destination[j] = j % lanes * mask_bytes(layout) + offset;
        }
    }
    run_lists(state, k, tables, jobs);
}

void integrate(State& state, const Kernels& k, Recording& r, bool per_block) {
    Counters counters{};
    Local ours, theirs;
    for (size_t b = 0; b < r.batches.size(); ++b) {
        k.integrate(*r.tables, r.masks_of(b), r.batches[b].valid, per_block, 5, ours.values, counters);
        kernels_for(Set::scalar)
            ->integrate(*r.tables, r.masks_of(b), r.batches[b].valid, per_block, 5, theirs.values, counters);
        if (!same(&ours, &theirs, 1)) return state.SkipWithError(wrong);
    }
    counters = {};
    k.integrate(*r.tables, r.masks_of(0), r.batches[0].valid, per_block, 5, ours.values, counters);
    const auto once = [&](size_t b) {
        k.integrate(*r.tables, r.masks_of(b), r.batches[b].valid, per_block, 5, ours.values, counters);
    };
    replay(state, k,
           {.inputs = r.batches.size(),
            .run = once,
            .items = of_batch,
            .bytes_per_item = double(mask_bytes(r.tables->layout))});
}

void rotate(State& state, const Kernels& k, Recording& r) {
    Local ours, theirs;
    for (size_t b = 0; b < r.batches.size(); ++b) {
        k.rotate(r.batches[b], 5, r.locals[b].values, ours.values);
        kernels_for(Set::scalar)->rotate(r.batches[b], 5, r.locals[b].values, theirs.values);
        if (!same(&ours, &theirs, 1)) return state.SkipWithError(wrong);
    }
    const auto once = [&](size_t b) { k.rotate(r.batches[b], 5, r.locals[b].values, ours.values); };
    replay(state, k,
           {.inputs = r.batches.size(),
            .run = once,
            .items = of_batch,
            .bytes_per_item = double(sizeof(Local)) / lanes});
}

void downsample(State& state, const Kernels& k, Recording& r) {
    const uint32_t blocks = mask_blocks(r.tables->layout), bytes = mask_bytes(r.tables->layout);
    uint8_t ours[256], theirs[256];
    const size_t count = r.masks.size() / bytes;
    for (size_t m = 0; m < count; ++m) {
        k.downsample(&r.masks[m * bytes], blocks, ours);
        kernels_for(Set::scalar)->downsample(&r.masks[m * bytes], blocks, theirs);
        if (!same(ours, theirs, blocks)) return state.SkipWithError(wrong);
    }
    const auto once = [&](size_t m) { k.downsample(&r.masks[m * bytes], blocks, ours); };
    replay(state, k,
           {.inputs = count,
            .run = once,
            .items = one,
            .bytes_per_item = double(bytes),
            .working_set = r.masks.size()});
}

void shade(State& state, const Kernels& k, Recording& r) {
    float light[75];
    for (int i = 0; i < 75; ++i)
        light[i] = 1.0f / static_cast<float>(i + 1);
    const size_t count = r.transfer.size() / 25;
    std::vector<float> ours(count * 3), theirs(count * 3);
    k.shade(light, 5, r.transfer.data(), 100, count, ours.data());
    kernels_for(Set::scalar)->shade(light, 5, r.transfer.data(), 100, count, theirs.data());
    if (!same(ours.data(), theirs.data(), ours.size())) return state.SkipWithError(wrong);
    constexpr size_t part = 64;
    const auto size_of = [&](size_t i) { return std::min(part, count - i * part); };
    const auto once = [&](size_t i) {
        k.shade(light, 5, &r.transfer[i * part * 25], 100, size_of(i), &ours[i * part * 3]);
    };
    replay(state, k,
           {.inputs = (count + part - 1) / part,
            .run = once,
            .items = size_of,
            .bytes_per_item = 112,
            .flops_per_item = 150,
            .working_set = count * 100});
}

void evaluate(State& state, const Kernels& k) {
    constexpr size_t count = 4096;
    Aligned<float> x(count), y(count), z(count), ours(count * 25), theirs(count * 25);
    for (size_t i = 0; i < count; ++i) {
        const double h = 1 - 2 * (double(i) + 0.5) / count, q = std::sqrt(1 - h * h),
                     p = 2.39996322972865332 * double(i);
        x[i] = float(q * std::cos(p));
        y[i] = float(q * std::sin(p));
        z[i] = float(h);
    }
    k.evaluate_sh(x.data(), y.data(), z.data(), count, ours.data());
    kernels_for(Set::scalar)->evaluate_sh(x.data(), y.data(), z.data(), count, theirs.data());
    if (!same(ours.data(), theirs.data(), ours.size())) return state.SkipWithError(wrong);
    constexpr size_t part = 64;
    const auto once = [&](size_t i) {
        k.evaluate_sh(&x[i * part], &y[i * part], &z[i * part], part, &ours[i * part * 25]);
    };
    replay(state, k,
           {.inputs = count / part,
            .run = once,
            .items = [](size_t) { return double(part); },
            .bytes_per_item = 112});
}

void roof(State& state, size_t bytes, bool random) {
    double rate = 0;
    for (auto _ : state)
        benchmark::DoNotOptimize(rate = random ? gather_peak(bytes) : load_peak(bytes));
    state.counters["bytes_per_second_peak"] = rate;
}

void add(const std::string& name, std::function<void(State&)> body) {
    benchmark::RegisterBenchmark(name.c_str(), [name, body](State& state) {
        running = name;
        body(state);
    });
}

// One stream of transfer vectors.
void encode(State& state, const Kernels& k, Recording& r, Format format) {
    const Encoding encoding{Quantity::transfer, format, 5, {1, 1, 1, 1, 1}};
    Aligned<uint8_t> ours(lanes * most_encoded_bytes), theirs(lanes * most_encoded_bytes);
    const auto run = [&](Set set, size_t b, Aligned<uint8_t>& out) {
        output_kernels_for(set)->encode(encoding, r.batches[b], r.locals[b].values, out.data(),
                                        encoded_bytes(encoding));
    };
    for (size_t b = 0; b < r.batches.size(); ++b) {
        run(set_of(k), b, ours);
        run(Set::scalar, b, theirs);
        if (ours != theirs) return state.SkipWithError(wrong);
    }
    const OutputKernels& kernels = *output_kernels_for(set_of(k));
    const auto once = [&](size_t b) {
        kernels.encode(encoding, r.batches[b], r.locals[b].values, ours.data(), encoded_bytes(encoding));
    };
    replay(state, k, {.inputs = r.batches.size(), .run = once, .items = of_batch});
}

// A hand of gold seen from the side, roughness 0.4, under glossy transfer or a sky of noise.
struct Gold {
    Aligned<float> memory, texels;
    CellTables cells{};
    SkyMap sky{};
    Reflection reflections[lanes] = {};

    explicit Gold(const Recording& r) {
        const MaskLayout& layout = r.tables->layout;
        memory.resize(cell_table_size(layout));
        std::vector<SampleBit> samples(mask_bits(layout));
        cells = build_cell_tables(layout, r.tables->scale, samples.data(), memory.data());
        uint32_t count = 0;
        for (uint32_t level = 0; level < sky_levels; ++level) {
            sky.size[level] = 200 >> level;
            sky.begin[level] = count;
            count += sky.size[level] * sky.size[level];
        }
        texels.resize(size_t(count) * 4);
        for (size_t i = 0; i < texels.size(); ++i)
            texels[i] = i % 4 == 3 ? 0.0f : float(i % 97);
        sky.texels = texels.data();
        for (Reflection& reflection : reflections) {
            reflection = {Lobe::ggx, 0, 0.16f, 0.9f, {0, 0, 0}, {1, 0.77f, 0.34f}, {0.48f, 0.36f, 0.8f}};
        }
    }
};

// Times a light kernel over all batches, once it has given the reference's bits.
template<class Out, class Run>
void replay_light(State& state, const Kernels& k, const Recording& r, const Run& run) {
    Out ours = {}, theirs = {};
    const LightKernels& kernels = *light_kernels_for(set_of(k));
    for (size_t b = 0; b < r.batches.size(); ++b) {
        run(kernels, b, ours);
        run(*light_kernels_for(Set::scalar), b, theirs);
        if (!same(&ours, &theirs, 1)) return state.SkipWithError(wrong);
    }
    replay(state, k,
           {.inputs = r.batches.size(), .run = [&](size_t b) { run(kernels, b, ours); }, .items = of_batch});
}

void glossy(State& state, const Kernels& k, Recording& r, uint32_t channels) {
    const Gold gold(r);
    struct alignas(64) Channels {
        float values[3][25][lanes];
    };
    const auto run = [&](const LightKernels& kernels, size_t b, Channels& out) {
        kernels.integrate_glossy(*r.tables, gold.cells, r.masks_of(b), r.batches[b].valid, gold.reflections,
                                 channels, r.locals[b].values, out.values);
    };
    replay_light<Channels>(state, k, r, run);
}

void sky(State& state, const Kernels& k, Recording& r) {
    const Gold gold(r);
    struct alignas(64) Colours {
        float values[3][lanes];
    };
    const auto run = [&](const LightKernels& kernels, size_t b, Colours& out) {
        kernels.integrate_sky(*r.tables, gold.cells, gold.sky, r.batches[b], r.masks_of(b), nullptr,
                              out.values);
    };
    replay_light<Colours>(state, k, r, run);
}

} // namespace

void register_all() {
    benchmark::AddCustomContext("instructions", counting_method());
    for (const size_t kilobytes : {32, 512, 2048, 8192}) {
        for (const bool random : {false, true}) {
            benchmark::RegisterBenchmark(
                ((random ? "machine/gather/" : "machine/load/") + std::to_string(kilobytes) + "KB").c_str(),
                [=](State& state) { roof(state, kilobytes << 10, random); })
                ->Iterations(1);
        }
    }
    benchmark::RegisterBenchmark("machine/flops", [](State& state) {
        double rate = 0;
        for (auto _ : state)
            benchmark::DoNotOptimize(rate = flop_peak());
        state.counters["flops_peak"] = rate;
    })->Iterations(1);
    benchmark::RegisterBenchmark("machine/issue", [](State& state) {
        double rate = 0;
        for (auto _ : state)
            benchmark::DoNotOptimize(rate = issue_peak());
        state.counters["instructions_per_second_peak"] = rate;
    })->Iterations(1);
    const auto standard = [](auto body) {
        return [body](State& state, const Kernels& k) { body(state, k, recording(Quality::standard)); };
    };
    const auto fine = [](auto body) {
        return [body](State& state, const Kernels& k) { body(state, k, recording(Quality::fine)); };
    };
    const auto lists = [](State& state, const Kernels& k, Recording& r) {
        run_lists(state, k, *r.tables, r.jobs);
    };
    const auto bits = [](State& state, const Kernels& k, Recording& r) { integrate(state, k, r, false); };
    const auto blocks = [](State& state, const Kernels& k, Recording& r) { integrate(state, k, r, true); };
    const std::pair<std::string, std::function<void(State&, const Kernels&)>> all[] = {
        {"prepare_batch/hand", standard(prepare)},
        {"select_clusters/hand", standard(select)},
        {"cluster_jobs/standard", standard(clusters)},
        {"cluster_jobs/fine", fine(clusters)},
        {"fading_cluster_jobs/standard", standard(fading_clusters)},
        {"run_fading_jobs/standard", standard(run_fading)},
        {"split_parts/standard", standard(split_parts)},
        {"both_sides_jobs/at_once",
         standard([](State& t, const Kernels& k, Recording& r) { both_sides(t, k, r, true); })},
        {"both_sides_jobs/side_by_side",
         standard([](State& t, const Kernels& k, Recording& r) { both_sides(t, k, r, false); })},
        {"triangle_jobs/hand", standard(triangles)},
        {"fan_jobs/hand", standard(fans)},
        {"run_jobs/standard", standard(lists)},
        {"run_jobs/fine", fine(lists)},
        {"run_jobs/random_16KB", [](State& state, const Kernels& k) { run_random(state, k, 16); }},
        {"run_jobs/random_256KB", [](State& state, const Kernels& k) { run_random(state, k, 64); }},
        {"run_jobs/random_1MB", [](State& state, const Kernels& k) { run_random(state, k, 128); }},
        {"run_jobs/random_4MB", [](State& state, const Kernels& k) { run_random(state, k, 256); }},
        {"integrate/standard", standard(bits)},
        {"integrate/fine", fine(bits)},
        {"integrate/per_block", standard(blocks)},
        {"rotate/hand", standard(rotate)},
        {"downsample/standard", standard(downsample)},
        {"downsample/fine", fine(downsample)},
        {"shade/hand", standard(shade)},
        {"encode/float16",
         standard([](State& t, const Kernels& k, Recording& r) { encode(t, k, r, Format::float16); })},
        {"encode/packed8",
         standard([](State& t, const Kernels& k, Recording& r) { encode(t, k, r, Format::packed8); })},
        {"integrate_glossy/grey",
         standard([](State& t, const Kernels& k, Recording& r) { glossy(t, k, r, 1); })},
        {"integrate_glossy/coloured",
         standard([](State& t, const Kernels& k, Recording& r) { glossy(t, k, r, 3); })},
        {"integrate_sky/standard", standard(sky)},
        {"evaluate_sh/sphere", [](State& state, const Kernels& k) { evaluate(state, k); }},
    };
    for (const auto& [name, body] : all) {
        for (const Set set : {Set::scalar, Set::sse4, Set::avx2, Set::avx512, Set::neon}) {
            const Kernels* k = kernels_for(set);
            if (k) add(name + "/" + k->name, [body = body, k](State& state) { body(state, *k); });
        }
    }
}

} // namespace nusselt::bench
