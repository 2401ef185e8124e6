// Which blocks of a mask are all alike. Included inside HWY_NAMESPACE, once for each instruction set, behind `hn`:
// no guard, no namespace, no includes of its own.

// Of the 64 blocks of 16 bits from `mask` on (aligned to 64 bytes), a bit each: those wholly blocked, and those
// wholly open. The others are blocked in part.
HWY_INLINE void classify_blocks(const uint8_t* mask, uint64_t& full, uint64_t& open) {
    const hn::CappedTag<uint16_t, 32> d;
    constexpr uint32_t step = hn::MaxLanes(hn::CappedTag<uint16_t, 32>());
    uint8_t all[16] = {}, none[16] = {};
    for (uint32_t i = 0; i < 64; i += step) {
        const auto bits = hn::Load(d, reinterpret_cast<const uint16_t*>(mask) + i);
        hn::StoreMaskBits(d, hn::Eq(bits, hn::Set(d, 0xFFFF)), all + i / 8);
        hn::StoreMaskBits(d, hn::Eq(bits, hn::Zero(d)), none + i / 8);
    }
    std::memcpy(&full, all, 8);
    std::memcpy(&open, none, 8);
}
