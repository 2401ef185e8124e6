#include "jobs/graph.h"

#include "jobs/float_environment.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <new>
#include <thread>
#include <type_traits>

namespace nusselt::jobs {

namespace {

struct alignas(64) Node {
    NodeDesc desc;
    uint32_t first_edge = no_node;
    uint32_t dependencies = 0;
    uint32_t chunks = 1; // at least 1: a node without items is claimed and completed like any other
    std::atomic<uint32_t> pending = 0;    // dependencies that aren't complete
    std::atomic<uint32_t> unfinished = 0; // chunks
    std::atomic<uint64_t> next =
        0; // chunk to claim; overshoots `chunks` by at most one a thread, hence 64 bits
};

struct Edge {
    uint32_t after = 0;
    uint32_t next = no_node; // of the same `before`
};

// What the executor carries to a worker task; its index is the slot.
struct Worker {
    Graph* graph = nullptr;
};

// Stands in a ticket's place from the moment its index is taken until `enqueue` has returned.
const char unpublished_mark = 0;
void* const unpublished = const_cast<char*>(&unpublished_mark);

} // namespace

struct Graph {
    GraphLimits limits;
    Node* nodes = nullptr;
    Edge* edges = nullptr;
    std::atomic<uint32_t>* ready =
        nullptr; // nodes in the order in which they became ready; no_node: not written yet
    Worker* workers = nullptr;
    std::atomic<uint64_t>* slots = nullptr; // a bit is set while that worker is queued or running
    std::atomic<void*>* tickets = nullptr;
    std::atomic<std::thread::id>* seen_threads = nullptr;

    Executor executor; // of this run
    uint32_t worker_count = 0;
    uint32_t node_count = 0;
    uint32_t edge_count = 0;
    bool running = false; // started and not waited for

    alignas(64) std::atomic<uint32_t> ready_count = 0;
    std::atomic<uint32_t> first_open = 0; // all of `ready` before it is claimed to the end; a hint, may lag
    std::atomic<uint32_t> ticket_count = 0;
    std::atomic<uint32_t> nodes_left = 0;
    alignas(64) std::atomic<uint32_t> signal =
        0; // moves when nodes became ready and when the last one is complete
};

// create_graph makes them, nobody destroys them.
static_assert(std::is_trivially_destructible_v<Graph> && std::is_trivially_destructible_v<Node>);

namespace {

struct Layout {
    size_t nodes, edges, ready, workers, slots, tickets, seen_threads, bytes;
};

uint32_t slot_words(uint32_t workers) {
    return (workers + 63) / 64;
}

GraphLimits with_tickets(GraphLimits limits) {
    if (limits.tickets == 0) {
        const uint64_t tickets = uint64_t{limits.nodes} * limits.workers;
        limits.tickets = static_cast<uint32_t>(std::min<uint64_t>(tickets, 0xfffffffe));
    }
    return limits;
}

// All counts are below 2^32 and all elements at most 128 bytes, so 64 bits do not overflow.
Layout layout_of(const GraphLimits& limits) {
    uint64_t at = sizeof(Graph);
    const auto place = [&at](uint64_t count, uint64_t size) {
        at = (at + 63) & ~uint64_t{63};
        const uint64_t offset = at;
        at += count * size;
        return static_cast<size_t>(offset);
    };
    Layout layout;
    layout.nodes = place(limits.nodes, sizeof(Node));
    layout.edges = place(limits.edges, sizeof(Edge));
    layout.ready = place(limits.nodes, sizeof(std::atomic<uint32_t>));
    layout.workers = place(limits.workers, sizeof(Worker));
    layout.slots = place(slot_words(limits.workers), sizeof(std::atomic<uint64_t>));
    layout.tickets = place(limits.tickets, sizeof(std::atomic<void*>));
    layout.seen_threads = place(uint64_t{limits.workers} + 1, sizeof(std::atomic<std::thread::id>));
    layout.bytes = at <= static_cast<size_t>(-1) ? static_cast<size_t>(at) : 0;
    return layout;
}

template<class T>
T* make_array(void* memory, size_t offset, size_t count) {
    T* array = reinterpret_cast<T*>(static_cast<unsigned char*>(memory) + offset);
    for (size_t i = 0; i < count; ++i) {
        new (array + i) T();
    }
    return array;
}

void cpu_pause() {
#if defined(NUSSELT_FLOAT_SSE)
    _mm_pause();
#elif defined(NUSSELT_FLOAT_AARCH64)
    __asm__ volatile("yield");
#endif
}

uint32_t chunk_count(uint32_t items, uint32_t grain) {
    return items == 0 ? 1 : items / grain + (items % grain != 0);
}

// False when all workers of this run are queued or running.
bool take_slot(Graph& graph, uint32_t* slot) {
    for (uint32_t word = 0; word < slot_words(graph.worker_count); ++word) {
        const uint32_t here = std::min(graph.worker_count - word * 64, 64u);
        const uint64_t all = here == 64 ? ~uint64_t{0} : (uint64_t{1} << here) - 1;
        uint64_t taken = graph.slots[word].load();
        while ((taken & all) != all) {
            const uint64_t bit = ~taken & (taken + 1);
            if (graph.slots[word].compare_exchange_weak(taken, taken | bit)) {
                *slot = word * 64 + static_cast<uint32_t>(std::countr_zero(bit));
                return true;
            }
        }
    }
    return false;
}

void free_slot(Graph& graph, uint32_t slot) {
    graph.slots[slot / 64].fetch_and(~(uint64_t{1} << (slot % 64)));
}

bool take_ticket(Graph& graph, uint32_t* index) {
    uint32_t count = graph.ticket_count.load(std::memory_order_relaxed);
    do {
        if (count == graph.limits.tickets) return false;
    } while (!graph.ticket_count.compare_exchange_weak(count, count + 1, std::memory_order_acq_rel));
    *index = count;
    return true;
}

void run_worker(void* argument);

// Enqueues worker tasks until `wanted` are on their way or all are taken. The caller holds no chunk, and what
// they are to find is published already: so it does not matter how long the executor takes or what it runs in
// here. An executor that runs inline nests one worker in another, at most worker_count deep, because each
// holds a slot.
void summon(Graph& graph, uint64_t wanted) {
    if (!graph.executor.enqueue || !graph.executor.finish) return;
    uint32_t slot;
    for (; wanted > 0 && take_slot(graph, &slot); --wanted) {
        uint32_t index;
        if (!take_ticket(graph, &index)) {
            free_slot(graph, slot);
            return;
        }
        void* ticket = nullptr;
        bool taken = true;
        try {
            ticket = graph.executor.enqueue(graph.executor.user, run_worker, &graph.workers[slot]);
        } catch (...) {
            taken = false;
        }
        graph.tickets[index].store(ticket, std::memory_order_release);
        if (!taken) {
            free_slot(graph, slot);
            return;
        }
    }
}

void publish(Graph& graph, uint32_t node) {
    const uint32_t place = graph.ready_count.fetch_add(1, std::memory_order_acq_rel);
    graph.ready[place].store(node, std::memory_order_release);
}

void complete(Graph& graph, const Node& node) {
    uint64_t chunks = 0;
    for (uint32_t edge = node.first_edge; edge != no_node; edge = graph.edges[edge].next) {
        const uint32_t after = graph.edges[edge].after;
        if (graph.nodes[after].pending.fetch_sub(1, std::memory_order_acq_rel) == 1) {
            publish(graph, after);
            chunks += graph.nodes[after].chunks;
        }
    }
    const bool last = graph.nodes_left.fetch_sub(1, std::memory_order_acq_rel) == 1;
    if (chunks > 0 || last) {
        graph.signal.fetch_add(1);
        graph.signal.notify_one();
    }
    if (chunks > 1) summon(graph, chunks - 1); // this thread takes one itself
}

void count_thread(Graph& graph) {
    const std::thread::id self = std::this_thread::get_id();
    for (uint32_t i = 0; i <= graph.worker_count; ++i) {
        std::thread::id known = graph.seen_threads[i].load(std::memory_order_relaxed);
        if (known == std::thread::id() && graph.seen_threads[i].compare_exchange_strong(known, self)) return;
        if (known == self) return;
    }
}

// Claims chunks of a node until there are none. False if there were none to begin with.
bool work_on_node(Graph& graph, Node& node, uint32_t slot) {
    const uint64_t chunks = node.chunks;
    if (node.next.load(std::memory_order_relaxed) >= chunks) return false;
    uint64_t chunk = node.next.fetch_add(1, std::memory_order_relaxed);
    if (chunk >= chunks) return false;

    count_thread(graph);
    uint32_t finished = 0;
    {
        const FloatEnvironment environment;
        const NodeDesc desc = node.desc;
        do {
            const uint64_t begin = chunk * desc.grain;
            const uint64_t end = std::min<uint64_t>(begin + desc.grain, desc.items);
            if (begin < end && desc.work) {
                desc.work(desc.context, static_cast<uint32_t>(begin), static_cast<uint32_t>(end), slot);
            }
            ++finished;
            chunk = node.next.fetch_add(1, std::memory_order_relaxed);
        } while (chunk < chunks);
    }
    if (node.unfinished.fetch_sub(finished, std::memory_order_acq_rel) == finished) complete(graph, node);
    return true;
}

// The node that became ready first and has chunks left, if any.
bool work_once(Graph& graph, uint32_t slot) {
    uint32_t open = graph.first_open.load(std::memory_order_relaxed);
    const uint32_t end = graph.ready_count.load(std::memory_order_acquire);
    for (uint32_t i = open; i < end; ++i) {
        const uint32_t node = graph.ready[i].load(std::memory_order_acquire);
        if (node == no_node) continue; // about to be written, by a thread that will then work on it
        if (work_on_node(graph, graph.nodes[node], slot)) return true;
        if (i == open && graph.first_open.compare_exchange_strong(open, i + 1)) open = i + 1;
    }
    return false;
}

// Works until nothing is claimable; the value of `signal` from before the look that found nothing.
uint32_t work_on(Graph& graph, uint32_t slot) {
    for (;;) {
        const uint32_t signal = graph.signal.load();
        if (!work_once(graph, slot)) return signal;
    }
}

void run_worker(void* argument) {
    Worker* worker = static_cast<Worker*>(argument);
    Graph& graph = *worker->graph;
    uint32_t slot = static_cast<uint32_t>(worker - graph.workers);
    do {
        const uint32_t signal = work_on(graph, slot);
        free_slot(graph, slot);
        // Nodes that became ready since had no slot of ours to summon a worker with. Either their publisher
        // sees the slot free or we see the signal: both sides write first, then read, sequentially
        // consistent.
        if (graph.signal.load() == signal || done(graph)) return;
    } while (take_slot(graph, &slot));
}

} // namespace

size_t graph_bytes(const GraphLimits& limits) {
    return limits.workers == 0 ? 0 : layout_of(with_tickets(limits)).bytes;
}

Graph* create_graph(void* memory, size_t bytes, const GraphLimits& limits) {
    const size_t needed = graph_bytes(limits);
    if (!memory || needed == 0 || bytes < needed) return nullptr;
    if (reinterpret_cast<uintptr_t>(memory) % graph_alignment != 0) return nullptr;

    Graph* graph = new (memory) Graph();
    graph->limits = with_tickets(limits);
    const Layout layout = layout_of(graph->limits);
    graph->nodes = make_array<Node>(memory, layout.nodes, graph->limits.nodes);
    graph->edges = make_array<Edge>(memory, layout.edges, graph->limits.edges);
    graph->ready = make_array<std::atomic<uint32_t>>(memory, layout.ready, graph->limits.nodes);
    graph->workers = make_array<Worker>(memory, layout.workers, graph->limits.workers);
    graph->slots = make_array<std::atomic<uint64_t>>(memory, layout.slots, slot_words(graph->limits.workers));
    graph->tickets = make_array<std::atomic<void*>>(memory, layout.tickets, graph->limits.tickets);
    graph->seen_threads = make_array<std::atomic<std::thread::id>>(memory, layout.seen_threads,
                                                                   size_t{graph->limits.workers} + 1);
    for (uint32_t i = 0; i < graph->limits.workers; ++i) {
        graph->workers[i].graph = graph;
    }
    for (uint32_t i = 0; i < graph->limits.tickets; ++i) {
        graph->tickets[i].store(unpublished, std::memory_order_relaxed);
    }
    return graph;
}

void clear(Graph& graph) {
    graph.node_count = 0;
    graph.edge_count = 0;
}

uint32_t add_node(Graph& graph, const NodeDesc& desc) {
    if (graph.node_count == graph.limits.nodes) return no_node;
    Node& node = graph.nodes[graph.node_count];
    node.desc = desc;
    node.desc.grain = std::max(desc.grain, 1u);
    node.first_edge = no_node;
    node.dependencies = 0;
    return graph.node_count++;
}

bool add_edge(Graph& graph, uint32_t before, uint32_t after) {
    if (graph.edge_count == graph.limits.edges || before >= after || after >= graph.node_count) return false;
    Node& node = graph.nodes[before];
    graph.edges[graph.edge_count] = {after, node.first_edge};
    node.first_edge = graph.edge_count++;
    ++graph.nodes[after].dependencies;
    return true;
}

void set_items(Graph& graph, uint32_t node, uint32_t items) {
    graph.nodes[node].desc.items = items;
}

bool start(Graph& graph, const Executor& executor) {
    if (graph.running) return false;
    graph.executor = executor;
    graph.worker_count = std::min(std::max(executor.concurrency, 1u), graph.limits.workers);
    graph.first_open.store(0, std::memory_order_relaxed);
    graph.ready_count.store(0, std::memory_order_relaxed);
    graph.nodes_left.store(graph.node_count, std::memory_order_relaxed);
    for (uint32_t i = 0; i < slot_words(graph.limits.workers); ++i) {
        graph.slots[i].store(0, std::memory_order_relaxed);
    }
    for (uint32_t i = 0; i <= graph.limits.workers; ++i) {
        graph.seen_threads[i].store(std::thread::id(), std::memory_order_relaxed);
    }
    for (uint32_t i = 0; i < graph.node_count; ++i) {
        Node& node = graph.nodes[i];
        node.chunks = chunk_count(node.desc.items, node.desc.grain);
        node.pending.store(node.dependencies, std::memory_order_relaxed);
        node.unfinished.store(node.chunks, std::memory_order_relaxed);
        node.next.store(0, std::memory_order_relaxed);
        graph.ready[i].store(no_node, std::memory_order_relaxed);
    }
    if (graph.node_count == 0) return true;

    graph.running = true;
    uint64_t chunks = 0;
    for (uint32_t i = 0; i < graph.node_count; ++i) {
        if (graph.nodes[i].dependencies > 0) continue;
        publish(graph, i);
        chunks += graph.nodes[i].chunks;
    }
    summon(graph, chunks);
    return true;
}

bool done(const Graph& graph) {
    return graph.nodes_left.load(std::memory_order_acquire) == 0;
}

// Why this ends. A thread that has claimed a chunk runs it to the end without calling the executor, and a
// node is published before the executor is asked for workers: so what this thread can't claim is being run by
// another one at this moment, and `signal` will move. No ticket need be finished for that; tasks that start
// only in `finish` find nothing left to do.
void wait(Graph& graph) {
    if (!graph.running) return;
    for (;;) {
        const uint32_t signal = work_on(graph, graph.worker_count);
        if (done(graph)) break;
        // Shorter than the way into the kernel and back, and about as long as a chunk's tail.
        constexpr int spins = 256;
        for (int i = 0; i < spins && graph.signal.load(std::memory_order_relaxed) == signal; ++i) {
            cpu_pause();
        }
        graph.signal.wait(signal);
    }
    // In order of index: whoever enqueued the task of ticket i is this thread, the one that called `start`,
    // or a task with a lower ticket, which has returned by now. So ticket i is published, and after the last
    // one no task is left that could add another.
    for (uint32_t i = 0; i < graph.ticket_count.load(std::memory_order_acquire); ++i) {
        void* ticket;
        while ((ticket = graph.tickets[i].load(std::memory_order_acquire)) == unpublished) {
            std::this_thread::yield();
        }
        graph.tickets[i].store(unpublished, std::memory_order_relaxed);
        if (!ticket) continue;
        try {
            graph.executor.finish(graph.executor.user, ticket);
        } catch (...) {
            // The contract forbids it, and there is nothing to be done about it here.
        }
    }
    graph.ticket_count.store(0, std::memory_order_relaxed);
    graph.running = false;
}

uint32_t slot_count(const Graph& graph) {
    return graph.limits.workers + 1;
}

uint32_t threads(const Graph& graph) {
    uint32_t count = 0;
    for (uint32_t i = 0; i <= graph.limits.workers; ++i) {
        count += graph.seen_threads[i].load(std::memory_order_relaxed) != std::thread::id();
    }
    return count;
}

const char* node_name(const Graph& graph, uint32_t node) {
    return graph.nodes[node].desc.name;
}

} // namespace nusselt::jobs
