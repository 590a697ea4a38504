// The vocabulary that kernels are written in: packs of sixteen numbers and masks of sixteen lanes.
//
// Pack<double> is always the portable one, because float64 is for accuracy and not for speed. All
// of this lives in the instruction set's own namespace: an inline function that the linker could
// take from another set's object file would stop the program on a machine that lacks that set.
#pragma once

#include "portable.h"

#if defined(GSFW_SIMD_avx512)
#include "avx512.h"
#elif defined(GSFW_SIMD_avx2)
#include "avx2.h"
#elif defined(GSFW_SIMD_neon)
#include "neon.h"
#endif

#include "rows.h"
