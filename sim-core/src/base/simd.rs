//! SIMD lanes: one source is compiled for several instruction sets, and the best of them is chosen at run time.
//!
//! Results have the same bits at every level if the code uses only operations that IEEE 754 rounds correctly, and no
//! lane reads another lane.

pub use fearless_simd::Level;

/// Runs code that is generic over the instruction set at a level: AVX-512, AVX2, or the baseline, which computes fused
/// multiply-adds in software. Other levels are left out, because the code is compiled in full for each level.
macro_rules! at_level {
    ($level:expr, $simd:ident => $what:expr) => {{
        use fearless_simd::Simd as _;
        let level = $level;
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        {
            if let Some($simd) = level.as_avx512() {
                $simd.vectorize(#[inline(always)] || $what)
            } else if let Some($simd) = level.as_avx2() {
                $simd.vectorize(#[inline(always)] || $what)
            } else {
                let $simd = level.as_sse2().expect("x86 has SSE2");
                $simd.vectorize(#[inline(always)] || $what)
            }
        }
        #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
        {
            fearless_simd::dispatch!(level, $simd => $what)
        }
    }};
}
pub(crate) use at_level;

/// Returns every level that this machine can run, for tests that compare bits.
#[cfg(test)]
pub(crate) fn levels() -> Vec<Level> {
    let best = Level::new();
    let mut levels = vec![best];
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        levels.extend(best.as_avx2().map(Level::Avx2));
        levels.extend(best.as_sse2().map(Level::Sse2));
    }
    levels
}
