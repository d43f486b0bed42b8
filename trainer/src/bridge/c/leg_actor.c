/*
 * The actor of a robot leg, exported by `trainer export --to c`.
 *
@ABOUT@
 *
 * Once a hop, at the apex, from
 *   observation[0]  horizontal velocity, m/s
 *   observation[1]  height above the ground, m
 *   observation[2]  density of the medium over that of water, from 0 to 1
 * to
 *   action[0]       leg angle at touchdown from the +x axis, rad
 *   action[1]       rate of the spring's rest length in stance, m/s
 *
 * Declare it where you call it (in C++ with extern "C"):
 *   void leg_actor(const float observation[3], float action[2]);
 *
 * The source is C99, and C++17. It uses two headers of a freestanding compiler
 * and no libc. The actions equal those of the controller to the last bit for
 * every observation: sums run from the bias over the inputs in ascending order,
 * and every product and every sum is rounded to a float before it is used
 * (LEG_ROUND below), so that no compiler option lets a product be fused with its
 * sum. Options that change single operations are refused, where the compiler
 * tells: -ffast-math and its parts. A processor that flushes subnormal numbers
 * to zero cannot be seen here; the self-test finds it.
 * Built with -DLEG_ACTOR_SELF_TEST, this file is a program that checks itself:
 * its exit status is 0, or the number of the test vector that failed (254 for
 * all from there on; 255 if the processor flushes subnormal numbers to zero).
 *
 * leg_tanhf is a translation of tanhf in musl libc:
 *
 *   Copyright (c) 2005-2020 Rich Felker, et al.
 *
 *   Permission is hereby granted, free of charge, to any person obtaining
 *   a copy of this software and associated documentation files (the
 *   "Software"), to deal in the Software without restriction, including
 *   without limitation the rights to use, copy, modify, merge, publish,
 *   distribute, sublicense, and/or sell copies of the Software, and to
 *   permit persons to whom the Software is furnished to do so, subject to
 *   the following conditions:
 *
 *   The above copyright notice and this permission notice shall be
 *   included in all copies or substantial portions of the Software.
 *
 *   THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND,
 *   EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF
 *   MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT.
 *   IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY
 *   CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT,
 *   TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE
 *   SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
 *
 * leg_expm1f is a translation of expm1f in FreeBSD, s_expm1f.c, which was
 * converted to float by Ian Lance Taylor, Cygnus Support, ian@cygnus.com:
 *
 *   Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved.
 *
 *   Developed at SunPro, a Sun Microsystems, Inc. business.
 *   Permission to use, copy, modify, and distribute this
 *   software is freely granted, provided that this notice
 *   is preserved.
 */

#include <float.h>
#include <stdint.h>

/* 16 means that half precision is computed as such, and float still as float. */
#if FLT_RADIX != 2 || FLT_MANT_DIG != 24 || (FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16)
#error "float must be IEEE 754 binary32, and computed as such"
#endif
#if defined(__FAST_MATH__) || defined(_M_FP_FAST)
#error "compile without -ffast-math: it changes the operations"
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "compile without -ffinite-math-only: an observation may be NaN"
#endif
#if defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "compile without -funsafe-math-optimizations and its parts: they change the operations"
#endif

/*
 * Rounds x to a float, here and now. The barrier is an empty instruction that the
 * compiler must expect to change x: it holds where the pragma FP_CONTRACT does
 * not, as in GCC, and costs no instruction. Elsewhere, and with -DLEG_NO_ASM, x
 * goes through memory, which costs more than half again as many instructions.
 */
#if !defined(__GNUC__) || defined(LEG_NO_ASM)
#define LEG_ROUND(x) { volatile float leg_rounded = (x); (x) = leg_rounded; }
#elif (defined(__x86_64__) || defined(__i386__)) && defined(__SSE__)
#define LEG_ROUND(x) __asm__("" : "+x"(x))
#elif defined(__aarch64__)
#define LEG_ROUND(x) __asm__("" : "+w"(x))
#elif defined(__arm__) && defined(__ARM_FP) && !defined(__SOFTFP__)
#define LEG_ROUND(x) __asm__("" : "+t"(x))
#elif defined(__riscv_flen)
#define LEG_ROUND(x) __asm__("" : "+f"(x))
#elif (defined(__arm__) && defined(__SOFTFP__)) || defined(__riscv_float_abi_soft)
#define LEG_ROUND(x) __asm__("" : "+r"(x))
#else
#define LEG_ROUND(x) { volatile float leg_rounded = (x); (x) = leg_rounded; }
#endif

#ifdef __cplusplus
extern "C"
#endif
void leg_actor(const float observation[3], float action[2]);

@TABLES@

union leg_bits {
    float f;
    uint32_t u;
};

static uint32_t leg_to_bits(float x)
{
    union leg_bits b;
    b.f = x;
    return b.u;
}

static inline float leg_add(float a, float b)
{
    float sum = a + b;
    LEG_ROUND(sum);
    return sum;
}

static inline float leg_mul(float a, float b)
{
    float product = a * b;
    LEG_ROUND(product);
    return product;
}

static int leg_is_nan(float x)
{
    return (leg_to_bits(x) & 0x7fffffffu) > 0x7f800000u;
}

@EXPM1[@static float leg_from_bits(uint32_t x)
{
    union leg_bits b;
    b.u = x;
    return b.f;
}

static inline float leg_div(float a, float b)
{
    float quotient = a / b;
    LEG_ROUND(quotient);
    return quotient;
}

/* exp(x) - 1 */
static float leg_expm1f(float x)
{
    const float ln2_hi = 0x1.62e3p-1f;
    const float ln2_lo = 0x1.2fefa2p-17f;
    const float inv_ln2 = 0x1.715476p+0f;
    const float q1 = -0x1.1110dp-5f;
    const float q2 = 0x1.9e602p-10f;
    const uint32_t hx = leg_to_bits(x) & 0x7fffffffu;
    const int sign = (int)(leg_to_bits(x) >> 31);
    float hi, lo, c = 0.0f, hfx, hxs, r1, t, e, twopk, uf, y;
    int32_t k;

    if (hx >= 0x4195b844u) { /* |x| >= 27 ln 2 */
        if (hx > 0x7f800000u) /* not a number */
            return x;
        if (sign)
            return -1.0f;
        if (hx > 0x42b17217u) /* x > log(FLT_MAX) */
            return leg_mul(x, 0x1p127f);
    }
    if (hx > 0x3eb17218u) { /* |x| > ln 2 / 2: reduce the argument */
        if (hx < 0x3f851592u) { /* |x| < 1.5 ln 2 */
            if (!sign) {
                hi = leg_add(x, -ln2_hi);
                lo = ln2_lo;
                k = 1;
            } else {
                hi = leg_add(x, ln2_hi);
                lo = -ln2_lo;
                k = -1;
            }
        } else {
            k = (int32_t)leg_add(leg_mul(inv_ln2, x), sign ? -0.5f : 0.5f);
            t = (float)k;
            hi = leg_add(x, -leg_mul(t, ln2_hi)); /* t * ln2_hi is exact here */
            lo = leg_mul(t, ln2_lo);
        }
        x = leg_add(hi, -lo);
        c = leg_add(leg_add(hi, -x), -lo);
    } else if (hx < 0x33000000u) { /* |x| < 2^-25 */
        return x;
    } else {
        k = 0;
    }

    hfx = leg_mul(0.5f, x);
    hxs = leg_mul(x, hfx);
    r1 = leg_add(1.0f, leg_mul(hxs, leg_add(q1, leg_mul(hxs, q2))));
    t = leg_add(3.0f, -leg_mul(r1, hfx));
    e = leg_mul(hxs, leg_div(leg_add(r1, -t), leg_add(6.0f, -leg_mul(x, t))));
    if (k == 0)
        return leg_add(x, -leg_add(leg_mul(x, e), -hxs));
    e = leg_add(leg_mul(x, leg_add(e, -c)), -c);
    e = leg_add(e, -hxs);
    if (k == -1)
        return leg_add(leg_mul(0.5f, leg_add(x, -e)), -0.5f);
    if (k == 1) {
        if (x < -0.25f)
            return leg_mul(-2.0f, leg_add(e, -leg_add(x, 0.5f)));
        return leg_add(1.0f, leg_mul(2.0f, leg_add(x, -e)));
    }
    twopk = leg_from_bits((uint32_t)(0x7f + k) << 23); /* 2^k */
    if (k < 0 || k > 56) {
        y = leg_add(leg_add(x, -e), 1.0f);
        y = k == 128 ? leg_mul(leg_mul(y, 2.0f), 0x1p127f) : leg_mul(y, twopk);
        return leg_add(y, -1.0f);
    }
    uf = leg_from_bits((uint32_t)(0x7f - k) << 23); /* 2^-k */
    if (k < 23)
        return leg_mul(leg_add(leg_add(x, -e), leg_add(1.0f, -uf)), twopk);
    return leg_mul(leg_add(leg_add(x, -leg_add(e, uf)), 1.0f), twopk);
}

@]EXPM1@@TANH[@static float leg_tanhf(float x)
{
    const uint32_t w = leg_to_bits(x) & 0x7fffffffu;
    const int sign = (int)(leg_to_bits(x) >> 31);
    float t;

    x = leg_from_bits(w);
    if (w > 0x7f800000u) { /* not a number */
        return x;
    } else if (w > 0x41200000u) { /* |x| > 10 */
        t = 1.0f;
    } else if (w > 0x3f0c9f54u) { /* |x| > log(3) / 2 */
        t = leg_expm1f(leg_mul(2.0f, x));
        t = leg_add(1.0f, -leg_div(2.0f, leg_add(t, 2.0f)));
    } else if (w > 0x3e82c578u) { /* |x| > log(5 / 3) / 2 */
        t = leg_expm1f(leg_mul(2.0f, x));
        t = leg_div(t, leg_add(t, 2.0f));
    } else if (w >= 0x00800000u) { /* |x| >= 2^-126 */
        t = leg_expm1f(leg_mul(-2.0f, x));
        t = leg_div(-t, leg_add(t, 2.0f));
    } else { /* subnormal */
        t = x;
    }
    return sign ? -t : t;
}

@]TANH@/* NaN gives the low bound. */
static float leg_clip(float x, float low, float high)
{
    if (leg_is_nan(x) || x < low)
        return low;
    return x > high ? high : x;
}

/* Weights row by row, one row for each output. */
static void leg_dense(const float *weight, const float *bias, int inputs, int outputs,
                      const float *x, float *y)
{
    int i, j;

    for (j = 0; j < outputs; j++) {
        float sum = bias[j];
        for (i = 0; i < inputs; i++)
            sum = leg_add(sum, leg_mul(*weight++, x[i]));
        y[j] = sum;
    }
}

@HIDDEN@void leg_actor(const float observation[3], float action[2])
{
    float front[LEG_WIDEST], back[LEG_WIDEST];
    int i;

    for (i = 0; i < 3; i++)
        front[i] = leg_mul(leg_add(observation[i], -leg_observation_offset[i]),
                           leg_observation_scale[i]);
@LAYERS@
    for (i = 0; i < 2; i++)
        action[i] = leg_clip(leg_add(leg_action_offset[i],
                                     leg_mul(leg_action_scale[i], @OUTPUT@)),
                             leg_action_low[i], leg_action_high[i]);
}

#ifdef LEG_ACTOR_SELF_TEST
@VECTORS@

int main(void)
{
    volatile float least = 0x1p-126f, half = 0.5f;
    int i, j;

    if (leg_to_bits(least * half) != 0x00400000u)
        return 255; /* subnormal numbers are flushed to zero */
    for (i = 0; i < LEG_TEST_VECTORS; i++) {
        float action[2];
        leg_actor(leg_test_vectors[i], action);
        for (j = 0; j < 2; j++)
            if (leg_to_bits(action[j]) != leg_to_bits(leg_test_vectors[i][3 + j]))
                return i < 253 ? i + 1 : 254;
    }
    return 0;
}
#endif
