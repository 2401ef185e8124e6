// The frame's task graph: nodes of items, edges between nodes, run by whatever threads an Executor lends.
#pragma once

#include "nusselt/executor.h"

#include <cstddef>
#include <cstdint>

namespace nusselt::jobs {

// Fixed when a graph is made; nothing is allocated afterwards.
struct GraphLimits {
    uint32_t nodes = 0;
    uint32_t edges = 0;
    uint32_t workers = 1; // a run uses min(executor.concurrency, workers); at least 1
    uint32_t tickets = 0; // enqueued tasks in one run; 0: nodes * workers, which is always enough. A run that
                          // uses them up goes on with the threads that it has
};

// `work` runs for disjoint ranges that cover [0, items), begins in ascending order, each a multiple of the
// grain. No two calls that overlap in time have the same `slot`, and slot < slot_count(graph): it indexes
// scratch memory. It must not throw, block, allocate, or call the functions of this header. The
// floating-point environment is the default one (see float_environment.h).
struct NodeDesc {
    const char* name = ""; // borrowed
    void (*work)(void* context, uint32_t begin, uint32_t end, uint32_t slot) = nullptr;
    void* context = nullptr;
    uint32_t items = 0; // 0: `work` isn't called, the dependents go on
    uint32_t grain = 1; // items a call; 0 means 1
};

constexpr uint32_t no_node = 0xffffffffu;
constexpr size_t graph_alignment = 64;

struct Graph;

// Bytes of memory that a graph of these limits lives in; 0 when they cannot be meant (no worker, or an
// overflow).
size_t graph_bytes(const GraphLimits& limits);

// Makes an empty graph in the caller's memory, which it never frees. Null when the memory is smaller than
// graph_bytes(limits) or not aligned to graph_alignment. There is nothing to destroy: after `wait` the memory
// may be reused.
Graph* create_graph(void* memory, size_t bytes, const GraphLimits& limits);

// Building: from one thread, never between `start` and the return of `wait`.

// Forgets all nodes and edges.
void clear(Graph& graph);

// The node's index, counted from 0 in order of adding; no_node when there is no room.
uint32_t add_node(Graph& graph, const NodeDesc& desc);

// `after` starts when all items of `before` are done, and sees what they wrote. False when there is no room,
// or unless before < after < nodes: so a graph has no cycle.
bool add_edge(Graph& graph, uint32_t before, uint32_t after);

// A new count for the next run.
void set_items(Graph& graph, uint32_t node, uint32_t items);

// Running.

// Hands the graph to the executor and returns; with an executor that runs inline, when the work is done.
// False, and nothing is done, while an earlier run has not been waited for. An executor without functions is
// legal: then all work is done in `wait`. A graph runs any number of times.
bool start(Graph& graph, const Executor& executor);

// Every item is done and its results can be read. Any thread may ask; `wait` must be called all the same, and
// before it returns neither the graph nor what `work` uses may be freed.
bool done(const Graph& graph);

// Works through the graph until every item is done, then finishes every ticket, each exactly once. On return
// every task has returned. One thread, after `start` has returned; any thread will do. Without a run, returns
// at once.
void wait(Graph& graph);

// limits.workers + 1: one for each worker task, one for the waiting thread.
uint32_t slot_count(const Graph& graph);

// Distinct threads that took part in the last run; counts no further than slot_count. After `wait`.
uint32_t threads(const Graph& graph);

const char* node_name(const Graph& graph, uint32_t node);

} // namespace nusselt::jobs
