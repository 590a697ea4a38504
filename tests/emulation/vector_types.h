// Vector types: float4 and its like, sized and aligned as CUDA has them.
#pragma once

#define EMULATION_VECTOR_TYPES(scalar, name, align2, align4)                                     \
  struct alignas(align2) name##2 {                                                               \
    scalar x, y;                                                                                 \
  };                                                                                             \
  struct name##3 {                                                                               \
    scalar x, y, z;                                                                              \
  };                                                                                             \
  struct alignas(align4) name##4 {                                                               \
    scalar x, y, z, w;                                                                           \
  };                                                                                             \
  inline name##2 make_##name##2(scalar x, scalar y) { return {x, y}; }                           \
  inline name##3 make_##name##3(scalar x, scalar y, scalar z) { return {x, y, z}; }              \
  inline name##4 make_##name##4(scalar x, scalar y, scalar z, scalar w) { return {x, y, z, w}; }

EMULATION_VECTOR_TYPES(float, float, 8, 16)
EMULATION_VECTOR_TYPES(double, double, 16, 16)
EMULATION_VECTOR_TYPES(int, int, 8, 16)
EMULATION_VECTOR_TYPES(unsigned, uint, 8, 16)
EMULATION_VECTOR_TYPES(long long, longlong, 16, 16)
EMULATION_VECTOR_TYPES(unsigned long long, ulonglong, 16, 16)
EMULATION_VECTOR_TYPES(unsigned char, uchar, 2, 4)
EMULATION_VECTOR_TYPES(unsigned short, ushort, 4, 8)

#undef EMULATION_VECTOR_TYPES

struct dim3 {
  unsigned x = 1, y = 1, z = 1;
};
