// A graph whose work checks every promise that jobs/graph.h makes to it.
#pragma once

#include "jobs/graph.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <new>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace nusselt::test {

struct AlignedMemory {
    explicit AlignedMemory(size_t size)
        : bytes(size), data(::operator new(size, std::align_val_t(jobs::graph_alignment))) {}
    ~AlignedMemory() { ::operator delete(data, std::align_val_t(jobs::graph_alignment)); }
    AlignedMemory(const AlignedMemory&) = delete;
    AlignedMemory& operator=(const AlignedMemory&) = delete;
    size_t bytes;
    void* data;
};

struct NodeSpec {
    uint32_t items;
    uint32_t grain;
};
using EdgeSpec = std::pair<uint32_t, uint32_t>;

class CheckedGraph {
public:
    CheckedGraph(const std::vector<NodeSpec>& specs, const std::vector<EdgeSpec>& edges, uint32_t workers,
                 uint32_t tickets = 0)
        : limits{static_cast<uint32_t>(specs.size()), static_cast<uint32_t>(edges.size()), workers, tickets},
          memory(jobs::graph_bytes(limits)), graph(jobs::create_graph(memory.data, memory.bytes, limits)),
          contexts(specs.size()), slot_used(workers + 1) {
        if (!graph) throw std::bad_alloc();
        for (size_t i = 0; i < specs.size(); ++i) {
            Context& context = contexts[i];
            context.owner = this;
            context.spec = specs[i];
            context.hits = std::vector<uint32_t>(specs[i].items);
            EXPECT_EQ(jobs::add_node(*graph, {"node", work, &context, specs[i].items, specs[i].grain}), i);
        }
        for (const auto& [before, after] : edges) {
            EXPECT_TRUE(jobs::add_edge(*graph, before, after));
            contexts[after].before.push_back(before);
        }
    }

    void run(const Executor& executor) {
        begin();
        ASSERT_TRUE(jobs::start(*graph, executor));
        jobs::wait(*graph);
        check();
    }

    void begin() {
        for (Context& context : contexts) {
            std::fill(context.hits.begin(), context.hits.end(), 0u);
            context.done = 0;
        }
        complaints = 0;
    }

    void check() {
        EXPECT_TRUE(jobs::done(*graph));
        EXPECT_EQ(complaints.load(), 0u) << "dependencies, slots or chunks";
        uint64_t wrong = 0;
        for (const Context& context : contexts) {
            for (const uint32_t hits : context.hits) {
                wrong += hits != 1;
            }
        }
        EXPECT_EQ(wrong, 0u) << "items not done exactly once";
    }

    jobs::Graph& operator*() { return *graph; }

private:
    struct Context {
        CheckedGraph* owner = nullptr;
        NodeSpec spec{};
        std::vector<uint32_t> before;
        std::vector<uint32_t> hits; // plain on purpose: a thread sanitizer sees unordered access
        std::atomic<uint32_t> done = 0;
    };

    static void work(void* pointer, uint32_t begin, uint32_t end, uint32_t slot) {
        Context& context = *static_cast<Context*>(pointer);
        CheckedGraph& self = *context.owner;
        const uint32_t grain = std::max(context.spec.grain, 1u);
        bool fine = slot < self.slot_used.size() && begin < end && begin % grain == 0 && end - begin <= grain;
        if (fine) fine = !self.slot_used[slot].exchange(true);
        for (const uint32_t before : context.before) {
            const Context& other = self.contexts[before];
            fine = fine && other.done.load(std::memory_order_relaxed) == other.spec.items;
            for (const uint32_t hits : other.hits) {
                fine = fine && hits == 1;
            }
        }
        for (uint32_t i = begin; i < end; ++i) {
            ++context.hits[i];
        }
        context.done.fetch_add(end - begin, std::memory_order_relaxed);
        if (slot < self.slot_used.size()) self.slot_used[slot] = false;
        if (!fine) ++self.complaints;
    }

    jobs::GraphLimits limits;
    AlignedMemory memory;
    jobs::Graph* graph;
    std::vector<Context> contexts;
    std::vector<std::atomic<bool>> slot_used;
    std::atomic<uint32_t> complaints = 0;
};

inline std::vector<NodeSpec> random_nodes(uint32_t count, uint32_t seed) {
    std::minstd_rand random{seed};
    std::vector<NodeSpec> specs;
    for (uint32_t i = 0; i < count; ++i) {
        const auto items = static_cast<uint32_t>(random() % 4 == 0 ? 0 : random() % 60);
        specs.push_back({items, static_cast<uint32_t>(random() % 9)});
    }
    return specs;
}

inline std::vector<EdgeSpec> random_edges(uint32_t nodes, uint32_t count, uint32_t seed) {
    std::minstd_rand random{seed};
    std::vector<EdgeSpec> edges;
    while (nodes > 1 && edges.size() < count) {
        const auto a = static_cast<uint32_t>(random() % nodes), b = static_cast<uint32_t>(random() % nodes);
        if (a != b) edges.emplace_back(std::min(a, b), std::max(a, b));
    }
    return edges;
}

} // namespace nusselt::test
