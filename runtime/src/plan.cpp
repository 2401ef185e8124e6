#include "plan.h"

#include "context_data.h"
#include "far.h"
#include "history.h"
#include "refit.h"
#include "regions.h"

namespace nusselt {

namespace {

using Work = void (*)(void* context, uint32_t begin, uint32_t end, uint32_t slot);

// A stage's work with its processor time.
template<Work work, const auto& zone_name>
void timed(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Frame& frame = *static_cast<Frame*>(context);
    // Seen by one task, it is seen by all that follow it in the graph: no stage works on a skipped one's
    // data.
    if (frame.cancelled.load(std::memory_order_relaxed)) return;
    const Zone zone(*frame.profiler, zone_name);
    Tally& tally = frame.workers[slot].tally;
    const double start = thread_cpu_nanoseconds();
    work(context, begin, end, slot);
    tally.cpu_ns += thread_cpu_nanoseconds() - start;
}

// The same for the stages before the receivers', which keep their own account of stages.
template<Work work, const auto& zone_name>
void timed_refit(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    Tally& tally = static_cast<Frame*>(context)->workers[slot].tally;
    const uint64_t start = ticks_now();
    timed<work, zone_name>(context, begin, end, slot);
    tally.ticks[refit_stage] += ticks_now() - start;
}

// Names as a host's profiler shows them; arrays, because a template takes no literal.
constexpr char extents_zone[] = "nusselt extents";
constexpr char scale_zone[] = "nusselt scale";
constexpr char points_zone[] = "nusselt points";
constexpr char clusters_zone[] = "nusselt clusters";
constexpr char bands_zone[] = "nusselt bands";
constexpr char far_zone[] = "nusselt far"; // frames of several objects only
constexpr char receivers_zone[] = "nusselt receivers";
// Frames with a history only.
constexpr char changes_zone[] = "nusselt changes";
constexpr char order_zone[] = "nusselt order";
constexpr char kept_zone[] = "nusselt kept";

// The graph has an item for each batch, of which there are seldom as many turns, and none is taken once the
// budget is spent, but the first: those left over cost neither a look at a clock nor a zone.
void timed_turns(void* context, uint32_t begin, uint32_t end, uint32_t slot) {
    const Frame& frame = *static_cast<Frame*>(context);
    const bool spent = frame.is_spent.load(std::memory_order_relaxed);
    if (begin > 0 && (spent || begin >= frame.history.turn_count)) return;
    timed<shadow_turns, receivers_zone>(context, begin, end, slot);
}

// Stages one after the other.
struct Chain {
    Frame& frame;
    uint32_t last = jobs::no_node;

    void stage(const char* name, Work work, uint32_t items, uint32_t grain) {
        jobs::Graph& graph = *frame.crew->graph;
        const uint32_t node = jobs::add_node(graph, {name, work, &frame, items, grain});
        if (last != jobs::no_node) jobs::add_edge(graph, last, node);
        last = node;
    }
};

void plan_without_history(Chain& c) {
    const Frame& f = c.frame;
    c.stage(extents_zone, timed_refit<measure_extents, extents_zone>, f.point_chunks, 1);
    c.stage(scale_zone, timed_refit<choose_scale, scale_zone>, 1, 1);
    c.stage(points_zone, timed_refit<place_points, points_zone>, f.point_chunks, 1);
    c.stage(clusters_zone, timed_refit<refit_clusters, clusters_zone>, f.cluster_count, 16);
    c.stage(bands_zone, timed_refit<choose_bands, bands_zone>, f.mesh_count, 1);
    if (f.far_table) c.stage(far_zone, timed<look_farther, far_zone>, f.mesh_count, 1);
    c.stage(receivers_zone, timed<shadow_regions, receivers_zone>, f.region_count, 1);
}

void plan_with_history(Chain& c) {
    const Frame& f = c.frame;
    const bool budget = f.budget_ns > 0, posed = !f.history.same_pose;
    if (budget) c.stage(order_zone, timed<start_clock, order_zone>, 1, 1);
    if (posed) {
        c.stage(extents_zone, timed_refit<measure_extents, extents_zone>, f.point_chunks, 1);
        c.stage(scale_zone, timed_refit<choose_scale, scale_zone>, 1, 1);
        c.stage(points_zone, timed_refit<place_and_compare, points_zone>, f.point_chunks, 1);
        c.stage(clusters_zone, timed_refit<refit_moved_clusters, clusters_zone>, f.cluster_count, 16);
        c.stage(bands_zone, timed_refit<choose_moved_bands, bands_zone>, f.mesh_count, 1);
        c.stage(changes_zone, timed_refit<gather_disturbed, changes_zone>, 1, 1);
    }
    c.stage(changes_zone, timed<find_changes, changes_zone>, f.region_count, 4);
    if (budget) {
        c.stage(order_zone, timed<order_turns, order_zone>, 1, 1);
        c.stage(receivers_zone, timed_turns, f.region_count * region_batches, 1);
    } else {
        c.stage(receivers_zone, timed<shadow_regions, receivers_zone>, f.region_count, 1);
    }
    c.stage(kept_zone, timed<write_kept, kept_zone>, f.region_count, 4);
}

} // namespace

void plan(Frame& frame) {
    jobs::clear(*frame.crew->graph);
    Chain chain{frame};
    if (frame.has_history) {
        plan_with_history(chain);
    } else {
        plan_without_history(chain);
    }
}

} // namespace nusselt
