"""Native code and its thin Python face: cpu (C++ with SIMD); shared maths; cuda later."""
