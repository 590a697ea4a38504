// The vocabulary of numbers: what a type T must offer to be used in the shared mathematics.
//
// T is float, double, or a pack of several of them. A pack is a type that
//   - is constructed from one double, which every lane then holds: T(0.5);
//   - has + - * / between packs and unary -;
//   - compares with < <= > >=, which give a mask; masks combine with & | and !;
//   - has overloads of the functions below in its own namespace.
// No code here branches on a T: lanes differ, so it selects.
#pragma once

// Each instruction set compiles its own copy of these templates in a namespace of its own, lest the
// linker give one set's instructions to all.
#ifndef GSFW_ISA
#define GSFW_ISA shared
#endif

// A build may define it: kernels of packs that are plain arrays compile ten times as fast when the
// compiler decides what to inline.
#if defined(GSFW_FUNCTION)
#elif defined(__CUDACC__) || defined(__CUDACC_RTC__)
#define GSFW_FUNCTION __device__ __forceinline__
#elif defined(__GNUC__) || defined(__clang__)
#define GSFW_FUNCTION inline __attribute__((always_inline))
#elif defined(_MSC_VER)
#define GSFW_FUNCTION __forceinline
#else
#define GSFW_FUNCTION inline
#endif

// NVRTC 13.0 leaves some short loops of sm_100 and sm_120 as they are, and keeps what they index
// in memory. Other compilers unroll them unasked.
#if defined(__CUDACC__) || defined(__CUDACC_RTC__)
#define GSFW_UNROLL _Pragma("unroll")
#else
#define GSFW_UNROLL
#endif

// GCC and Clang know the elementary functions without a header, CUDA's compilers bring their own.
#if (defined(__GNUC__) || defined(__clang__)) && !defined(__CUDACC_RTC__)
#define GSFW_ELEMENTARY(name) __builtin_##name
#else
#ifndef __CUDACC_RTC__
#include <math.h>
#endif
#define GSFW_ELEMENTARY(name) ::name
#endif

// A fused multiply-add that the hardware lacks is a slow library call.
#ifdef GSFW_FUSES
#elif defined(__FP_FAST_FMA) || defined(__FMA__) || defined(__ARM_FEATURE_FMA) || \
    defined(__CUDACC__) || defined(__CUDACC_RTC__)
#define GSFW_FUSES 1
#else
#define GSFW_FUSES 0
#endif

namespace gsfw {
namespace GSFW_ISA {

/// What comparing two T gives: bool, or a mask with one truth per lane.
template <class T>
using Mask = decltype(T(0.0) < T(0.0));

/// a * b + c, rounded once where the hardware can.
GSFW_FUNCTION float fma(float a, float b, float c) {
#if GSFW_FUSES
  return GSFW_ELEMENTARY(fmaf)(a, b, c);
#else
  return a * b + c;
#endif
}
GSFW_FUNCTION double fma(double a, double b, double c) {
#if GSFW_FUSES
  return GSFW_ELEMENTARY(fma)(a, b, c);
#else
  return a * b + c;
#endif
}

/// c - a * b, rounded once where the hardware can.
GSFW_FUNCTION float fma_negated(float a, float b, float c) { return fma(-a, b, c); }
GSFW_FUNCTION double fma_negated(double a, double b, double c) { return fma(-a, b, c); }

/// NaN for negative numbers.
GSFW_FUNCTION float square_root(float x) { return GSFW_ELEMENTARY(sqrtf)(x); }
GSFW_FUNCTION double square_root(double x) { return GSFW_ELEMENTARY(sqrt)(x); }

/// In radians; used for arguments >= 0, infinity included.
GSFW_FUNCTION float arc_tangent(float x) { return GSFW_ELEMENTARY(atanf)(x); }
GSFW_FUNCTION double arc_tangent(double x) { return GSFW_ELEMENTARY(atan)(x); }

GSFW_FUNCTION float absolute(float x) { return GSFW_ELEMENTARY(fabsf)(x); }
GSFW_FUNCTION double absolute(double x) { return GSFW_ELEMENTARY(fabs)(x); }

/// The second argument where either is NaN, as SSE's minps: minimum(x, bound) swallows a NaN x and
/// minimum(bound, x) keeps it.
GSFW_FUNCTION float minimum(float a, float b) { return a < b ? a : b; }
GSFW_FUNCTION double minimum(double a, double b) { return a < b ? a : b; }

/// The second argument where either is NaN, as SSE's maxps: maximum(x, bound) swallows a NaN x and
/// maximum(bound, x) keeps it.
GSFW_FUNCTION float maximum(float a, float b) { return a > b ? a : b; }
GSFW_FUNCTION double maximum(double a, double b) { return a > b ? a : b; }

/// ``a`` where ``mask``, else ``b``.
GSFW_FUNCTION float select(bool mask, float a, float b) { return mask ? a : b; }
GSFW_FUNCTION double select(bool mask, double a, double b) { return mask ? a : b; }

/// ``a`` where ``mask``, else 0.
GSFW_FUNCTION float keep(bool mask, float a) { return mask ? a : 0.0f; }
GSFW_FUNCTION double keep(bool mask, double a) { return mask ? a : 0.0; }

/// x within [low, high]. Keeps NaN, as torch does: what is not a number must fail the tests for
/// visibility, not pass them with a bound in its place.
template <class T>
GSFW_FUNCTION T clamp(const T& x, const T& low, const T& high) {
  return maximum(low, minimum(high, x));
}

/// True if torch's clamp passes its gradient: within the bounds or on them.
template <class T>
GSFW_FUNCTION Mask<T> within(const T& x, const T& low, const T& high) {
  return (x >= low) & (x <= high);
}

/// False for infinity and NaN.
template <class T>
GSFW_FUNCTION Mask<T> is_finite(const T& x) {
  return x - x <= T(0.0);
}

/// a * b - c * d with the digits that two roundings of almost equal products would cancel
/// (Kahan; see Jeannerod, Louvet and Muller 2013).
template <class T>
GSFW_FUNCTION T difference_of_products(const T& a, const T& b, const T& c, const T& d) {
  const T product = c * d;
  const T lost = fma(-c, d, product);
  return fma(a, b, -product) + lost;
}

}  // namespace GSFW_ISA
}  // namespace gsfw
