// Histories: what a shadow group remembers from one frame to the next, so that only what changed is computed.
#pragma once

#include "nusselt/context.h"

namespace nusselt {

// A history by value: generational, zero is null.
struct HistoryId {
    uint32_t slot = 0;
    uint32_t generation = 0;
};

// A frame that is given a history (FrameDesc::history) computes the receivers whose surroundings changed
// since the history's last frame; the others' results are kept and written again, bit for bit what computing
// them would give. A receiver is computed anew where its position, its normal or a triangle around it
// changed, or where a cluster of blockers that it could see changed, or came into its sight or left it. Where
// a mesh deforms anywhere, its levels of detail may change everywhere, and with them all that see it.
//
// The history belongs to a list of meshes, a quality and an order, and to which of the meshes receive and
// have masks; where a frame differs in one of these, all is computed and the history begins anew. It holds
// the results: 100 bytes (or fewer, by the order) and a mask (if masks are asked for) a vertex, and 30 more a
// vertex, beside the frame's own working memory (runtime/README.md). A history is in one frame at a time.
//
// Not worth it for a mesh of which everything moves in every frame: it would save nothing, and cost the
// copies.
Status create_history(Context* context, HistoryId* out);

// `busy` while a frame in flight uses it.
Status remove_history(Context* context, HistoryId history);

} // namespace nusselt
