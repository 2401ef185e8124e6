// Included once by each SIMD source, in namespace nusselt::kernels: the body of its function of `set`. Each set's namespace
// has a `table`. Highway leaves out the sets below the flags that the file is compiled with, and what a compiler lacks.
switch (set) {
#if HWY_ARCH_X86
#if HWY_TARGETS & HWY_SSE4
case Set::sse4:
    return &N_SSE4::table;
#endif
#if HWY_TARGETS & HWY_AVX2
case Set::avx2:
    return &N_AVX2::table;
#endif
#if HWY_TARGETS & HWY_AVX3
case Set::avx512:
    return &N_AVX3::table;
#endif
#else
case Set::neon:
    return &N_NEON::table;
#endif
default:
    return nullptr;
}
