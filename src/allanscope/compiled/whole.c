/* The overlapping terms of whole numbers: `cascade.c` takes them for what a device counts.

   Differences of counts are small whole numbers, of which a register holds two to four times as many
   as doubles. They are taken modulo 2^32, or 2^16 where that is enough, and are right because their
   own size is bounded (`to_whole`), whatever that of the phases. A sum of squares is used where
   doubles would have it without rounding (`LARGEST_SUM`): so the bits are those of doubles. */

#if defined(__AVX2__)

#include <immintrin.h>

enum {
    LONGEST_LAG = 63,
    NARROW = 23170, /* eight squares of it fit in 32 bits */
    AT_ONCE = 8,
    MOST_GATHERED = 1296, /* of every lag up to the longest: 256 / k + 1, and three before; a register */
    AT_MOST = 4 /* registers of squares that are added in 32 bits: two of each lane's */
};
#define LARGEST_SUM 0x1p53
#define WHOLE 6755399441055744.0 /* 1.5 x 2^52: a sum with it has no digits after the point */
#define MOST_BEND 1.8e8          /* 256 squares of it fit in 63 bits */
#define MOST_DISTANCE 1e15       /* twice it is below 2^51 */

/* Entries as whole numbers: half of them history, half new as on a rung, and room for as many more. */
enum { ROOM = ENTRIES + BATCH };
typedef struct {
    int32_t x[ROOM], z[ROOM], q[ROOM];                                   /* modulo 2^32; q twice, because it has halves */
    int32_t with_x[ROOM];                                                /* z, on rung 0 with the last phase */
    int16_t x_low[ROOM], z_low[ROOM], q_low[ROOM], with_x_low[ROOM]; /* modulo 2^16 */
} places;

typedef struct {
    const int32_t *x, *z, *q, *with_x; /* ENTRIES of `places` */
    const int16_t *x_low, *z_low, *q_low, *with_x_low;
    int32_t rises[LONGEST_LAG + 1];      /* sum of w of the new entries, by lag */
    double steepest, range, curve, bend; /* of x: the largest step, and from least to most;
                                            bounds of |e| / 2 k^2 and |2 r| / k^3 */
    int64_t stride;
} whole;

/* Take the entries from number `at` on. */
static whole whole_at(const places *from, int64_t at, int64_t stride) {
    return (whole){from->x + at, from->z + at, from->q + at, from->with_x + at, from->x_low + at,
                   from->z_low + at, from->q_low + at, from->with_x_low + at, {0}, 0.0, 0.0, 0.0, 0.0, stride};
}

/* The low 32 bits of eight whole numbers below 2^51: of a double near 2^52 they are its own. */
static inline __m256i low_bits(__m256d a, __m256d b) {
    const __m256d shift = _mm256_set1_pd(WHOLE);
    __m256 one = _mm256_castpd_ps(_mm256_add_pd(a, shift)), two = _mm256_castpd_ps(_mm256_add_pd(b, shift));
    __m256d both = _mm256_castps_pd(_mm256_shuffle_ps(one, two, _MM_SHUFFLE(2, 0, 2, 0)));
    return _mm256_castpd_si256(_mm256_permute4x64_pd(both, _MM_SHUFFLE(3, 1, 2, 0)));
}

static inline int32_t largest_of(__m256i v) {
    int32_t lane[AT_ONCE];
    _mm256_storeu_si256((__m256i *)lane, v);
    for (int i = 1; i < AT_ONCE; i++)
        if (lane[i] > lane[0]) lane[0] = lane[i];
    return lane[0];
}

static inline int32_t least_of(__m256i v) {
    return -largest_of(_mm256_sub_epi32(_mm256_setzero_si256(), v));
}

/* Keep the low 16 bits of sixteen entries. */
static inline void keep_low(__m256i a, __m256i b, int16_t *low) {
    const __m256i mask = _mm256_set1_epi32(0xFFFF);
    __m256i both = _mm256_packus_epi32(_mm256_and_si256(a, mask), _mm256_and_si256(b, mask));
    _mm256_storeu_si256((__m256i *)low, _mm256_permute4x64_epi64(both, _MM_SHUFFLE(3, 1, 2, 0)));
}

/* Raise `largest` to the sizes of four doubles. */
static inline __m256d with_sizes(__m256d largest, __m256d v) {
    return _mm256_max_pd(_mm256_andnot_pd(_mm256_set1_pd(-0.0), v), largest);
}

static inline double most_of(__m256d v) {
    lanes lane = (lanes)v;
    double most = lane[0];
    for (int i = 1; i < LANES; i++)
        if (lane[i] > most) most = lane[i];
    return most;
}

/* What entries from number `from` on say of their sizes, of a rung of any stride. */
static sizes sizes_of(const double *x, double stride, int64_t from, int64_t stop) {
    const double *z = x + ENTRIES, *q = z + ENTRIES;
    const __m256d shift = _mm256_set1_pd(WHOLE), half = _mm256_set1_pd(0.5 * stride);
    __m256d steps = _mm256_setzero_pd(), fractions = steps, curves = steps, rests = steps;
    for (int64_t j = from; j < stop; j += LANES) {
        int64_t i = least(j, stop - LANES);
        __m256d here = _mm256_loadu_pd(x + i), whole_part = _mm256_sub_pd(_mm256_add_pd(here, shift), shift);
        fractions = with_sizes(fractions, _mm256_sub_pd(whole_part, here));
        steps = with_sizes(steps, _mm256_sub_pd(here, _mm256_loadu_pd(x + i - 1)));
        if (stride == 1.0) continue;
        __m256d z0 = _mm256_loadu_pd(z + i), z1 = _mm256_loadu_pd(z + i - 1), q0 = _mm256_loadu_pd(q + i);
        __m256d before = _mm256_sub_pd(z1, _mm256_loadu_pd(z + i - 2));
        curves = with_sizes(curves, _mm256_sub_pd(_mm256_sub_pd(z0, z1), before));
        __m256d area = _mm256_mul_pd(half, _mm256_add_pd(z0, z1));
        rests = with_sizes(rests, _mm256_sub_pd(_mm256_sub_pd(q0, _mm256_loadu_pd(q + i - 1)), area));
    }
    double step = most_of(fractions) == 0.0 ? most_of(steps) : HUGE_VAL;
    return (sizes){step, most_of(curves), most_of(rests)};
}

/* Find what bounds the terms of lags up to k, from the sizes of the history and of what is new; return
   0 where one might not fit.

   With z'' for the second differences of z, and f for what the steps of q have beyond the trapezoids
   under z, above the lowest rung

       |e| <= 2 k^2 max |z''|,    |2 r| <= s k^3 / 3 max |z''| + 4 k max |f|. */
static int find_bounds(sizes old, sizes new, int64_t k, whole *to) {
    to->steepest = larger(old.step, new.step);
    if (to->stride == 1) {
        to->curve = to->steepest, to->bend = to->steepest / 3.0;
    } else {
        to->curve = larger(old.curve, new.curve) + 1.0;
        to->bend = (double)to->stride / 3.0 * to->curve + 4.0 * (larger(old.rest, new.rest) + 1.0);
    }
    double longest = (double)k, most_bend = larger(to->bend, to->steepest / 3.0);
    return most_bend * longest * longest * longest <= MOST_BEND;
}

static void find_rises(whole *to) {
    uint32_t rise = 0;
    for (int64_t k = 1; k <= LONGEST_LAG; k++) {
        rise += (uint32_t)to->x[ENTRIES - k] - (uint32_t)to->x[BATCH - k];
        to->rises[k] = (int32_t)rise;
    }
}

/* Take entries of a rung from number `from` up to `stop` as whole numbers, sixteen at a time; return 0
   where they are too far from their origin. `range` receives that of x. */
static int whole_entries(
    const double *rung, int64_t stride, int64_t from, int64_t stop, places *to, double *range) {
    const double *x = rung, *z = x + ENTRIES, *q = z + ENTRIES;
    __m256i least_x = _mm256_set1_epi32(INT32_MAX), most_x = _mm256_set1_epi32(INT32_MIN);
    __m256d far = _mm256_setzero_pd();
    for (int64_t j = from; j < stop; j += 2 * AT_ONCE) {
        __m256i xs[2], zs[2], qs[2], ys[2];
        for (int i = 0; i < 2; i++) {
            int64_t at = j + i * AT_ONCE;
            __m256d z_0 = _mm256_loadu_pd(z + at), z_1 = _mm256_loadu_pd(z + at + LANES);
            __m256d q_0 = _mm256_loadu_pd(q + at), q_1 = _mm256_loadu_pd(q + at + LANES);
            if (stride > 1) far = with_sizes(with_sizes(with_sizes(with_sizes(far, z_0), z_1), q_0), q_1);
            xs[i] = low_bits(_mm256_loadu_pd(x + at), _mm256_loadu_pd(x + at + LANES));
            zs[i] = low_bits(z_0, z_1);
            qs[i] = low_bits(_mm256_add_pd(q_0, q_0), _mm256_add_pd(q_1, q_1));
            ys[i] = stride == 1 ? _mm256_add_epi32(zs[i], xs[i]) : zs[i];
            least_x = _mm256_min_epi32(least_x, xs[i]), most_x = _mm256_max_epi32(most_x, xs[i]);
            _mm256_storeu_si256((__m256i *)(to->x + at), xs[i]);
            _mm256_storeu_si256((__m256i *)(to->z + at), zs[i]);
            _mm256_storeu_si256((__m256i *)(to->q + at), qs[i]);
            _mm256_storeu_si256((__m256i *)(to->with_x + at), ys[i]);
        }
        keep_low(xs[0], xs[1], to->x_low + j), keep_low(zs[0], zs[1], to->z_low + j);
        keep_low(qs[0], qs[1], to->q_low + j), keep_low(ys[0], ys[1], to->with_x_low + j);
    }
    *range = (double)largest_of(most_x) - (double)least_of(least_x);
    return most_of(far) < MOST_DISTANCE;
}

/* Take a full rung that begins no segment as whole numbers, for lags up to k; return 0 where they are
   none, or where a term might not fit. `known` is what the history was found to be when it was new: a
   frame that moves changes nothing of it. It receives what is new. */
static int to_whole(const double *rung, int64_t k, sizes *known, places *room, whole *to) {
    const int64_t oldest = (BATCH - 3 * k) & ~(int64_t)(2 * AT_ONCE - 1);
    double stride = (double)to->stride;
    sizes old = known->step < 0.0 ? sizes_of(rung, stride, oldest + 2, BATCH) : *known;
    sizes new = sizes_of(rung, stride, BATCH, ENTRIES);
    *known = new;
    if (!find_bounds(old, new, k, to)) return 0;
    if (!whole_entries(rung, to->stride, oldest, ENTRIES, room, &to->range)) return 0;
    find_rises(to);
    return 1;
}

static inline __m256i entries_at(const int32_t *p) { return _mm256_loadu_si256((const __m256i *)p); }

/* Add the squares of eight numbers of 32 bits to four sums. */
static inline __m256i with_squares(__m256i sums, __m256i v) {
    __m256i odd = _mm256_srli_epi64(v, 32);
    return _mm256_add_epi64(sums, _mm256_add_epi64(_mm256_mul_epi32(v, v), _mm256_mul_epi32(odd, odd)));
}

/* Add sums of 32 bits, without a sign, to those of 64. */
static inline __m256i with_narrow(__m256i sums, __m256i narrow) {
    __m256i low = _mm256_and_si256(narrow, _mm256_set1_epi64x(0xFFFFFFFF));
    return _mm256_add_epi64(sums, _mm256_add_epi64(low, _mm256_srli_epi64(narrow, 32)));
}

/* Sums of the lanes of four registers, as doubles: exact below 2^53. */
static inline __m256d totals_of(__m256i a, __m256i b, __m256i c, __m256i d) {
    __m256i ab = _mm256_add_epi64(_mm256_unpacklo_epi64(a, b), _mm256_unpackhi_epi64(a, b));
    __m256i cd = _mm256_add_epi64(_mm256_unpacklo_epi64(c, d), _mm256_unpackhi_epi64(c, d));
    __m256i low = _mm256_permute2x128_si256(ab, cd, 0x20), high = _mm256_permute2x128_si256(ab, cd, 0x31);
    __m256i all = _mm256_add_epi64(low, high);
    /* Each half beside a power of two that leaves it the last digits of a double. */
    const __m256i of_low = _mm256_set1_epi64x(0x4330000000000000), of_high = _mm256_set1_epi64x(0x4530000000000000);
    __m256d upper = _mm256_castsi256_pd(_mm256_or_si256(_mm256_srli_epi64(all, 32), of_high));
    __m256d lower = _mm256_castsi256_pd(_mm256_blend_epi32(all, of_low, 0xAA));
    return _mm256_add_pd(_mm256_sub_pd(upper, _mm256_set1_pd(0x1p84 + 0x1p52)), lower);
}

static inline void add_four(double *to, __m256d values) {
    _mm256_storeu_pd(to, _mm256_add_pd(_mm256_loadu_pd(to), values));
}

static inline int64_t total_of(__m256i sums) {
    __m128i two = _mm_add_epi64(_mm256_castsi256_si128(sums), _mm256_extracti128_si256(sums, 1));
    return _mm_cvtsi128_si64(_mm_add_epi64(two, _mm_unpackhi_epi64(two, two)));
}

/* The largest of sixteen numbers without a sign. */
static inline int64_t most_narrow(__m256i v) {
    __m128i eight = _mm_max_epu16(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1));
    __m128i rest = _mm_minpos_epu16(_mm_xor_si128(eight, _mm_set1_epi16(-1)));
    return 0xFFFF - (_mm_cvtsi128_si32(rest) & 0xFFFF);
}

/* w, d and h, with either width of entries. */
#define PHASE_TERMS(load, subtract)                                                              \
    __m256i x0 = load(0), x1 = load(1), x2 = load(2), x3 = load(3);                              \
    __m256i w = subtract(x0, x1), before = subtract(x1, x2), d = subtract(w, before);            \
    __m256i h = subtract(d, subtract(before, subtract(x2, x3)));

/* Squares of w, d and h. In 16 bits those of w and d, of half the size, fit in 32 for a whole batch. */
static inline void squares_of_phase(const whole *own, int64_t k, int is_narrow, __m256i *found) {
    __m256i ww = _mm256_setzero_si256(), dd = ww, hh = ww;
    if (is_narrow) {
#define LOAD(lags) _mm256_loadu_si256((const __m256i *)(own->x_low + j - (lags)*k))
        __m256i w_s = ww, d_s = ww;
        for (int64_t j = BATCH; j < ENTRIES;) {
            __m256i h_s = _mm256_setzero_si256();
            for (int i = 0; i < AT_MOST; i++, j += 2 * AT_ONCE) {
                PHASE_TERMS(LOAD, _mm256_sub_epi16)
                w_s = _mm256_add_epi32(w_s, _mm256_madd_epi16(w, w));
                d_s = _mm256_add_epi32(d_s, _mm256_madd_epi16(d, d));
                h_s = _mm256_add_epi32(h_s, _mm256_madd_epi16(h, h));
            }
            hh = with_narrow(hh, h_s);
        }
        ww = with_narrow(ww, w_s), dd = with_narrow(dd, d_s);
#undef LOAD
    } else {
#define LOAD(lags) entries_at(own->x + j - (lags)*k)
        for (int64_t j = BATCH; j < ENTRIES; j += AT_ONCE) {
            PHASE_TERMS(LOAD, _mm256_sub_epi32)
            ww = with_squares(ww, w), dd = with_squares(dd, d), hh = with_squares(hh, h);
        }
#undef LOAD
    }
    found[0] = ww, found[1] = dd, found[2] = hh;
}

#define LOAD(p, lags) _mm256_loadu_si256((const __m256i *)((p) + j - (lags)*k))

/* e, with either width of entries: `y` is z, on rung 0 with the last phase. */
#define E_TERMS(y, add, subtract)                                                                \
    __m256i inner = subtract(LOAD(y, 1), LOAD(y, 2));                                            \
    __m256i e = subtract(subtract(LOAD(y, 0), LOAD(y, 3)), add(inner, add(inner, inner)));

/* Squares of e in 16 bits; `most` receives the largest size that is found in them. */
static inline __m256i squares_of_narrow_e(const whole *own, int64_t k, int64_t *most) {
    __m256i ee = _mm256_setzero_si256(), sizes = ee;
    for (int64_t j = BATCH; j < ENTRIES;) {
        __m256i sum = _mm256_setzero_si256();
        for (int i = 0; i < AT_MOST; i++, j += 2 * AT_ONCE) {
            E_TERMS(own->with_x_low, _mm256_add_epi16, _mm256_sub_epi16)
            sum = _mm256_add_epi32(sum, _mm256_madd_epi16(e, e));
            sizes = _mm256_max_epu16(sizes, _mm256_abs_epi16(e));
        }
        ee = with_narrow(ee, sum);
    }
    *most = most_narrow(sizes);
    return ee;
}

/* Squares of e. Most fit in 16 bits far beyond what bounds promise. On rung 0 that can be seen: from
   one term to the next e moves by h. Where the first is right, and no size exceeds NARROW, a term
   that is not would have come from its neighbour in a step of 2^16 - 2 NARROW or more. */
static inline __m256i squares_of_e(const whole *own, int64_t k, double h_most) {
    const int32_t *y = own->with_x + BATCH;
    double bound = 2.0 * (double)k * (double)k * own->curve;
    int64_t most, inner = (int64_t)y[-k] - y[-2 * k];
    int32_t first = (int32_t)(uint32_t)((int64_t)y[0] - y[-3 * k] - 3 * inner);
    int continues = own->stride == 1 && h_most < 65536.0 - 2.0 * NARROW && first <= NARROW && first >= -NARROW;
    if (bound <= NARROW || continues) {
        __m256i narrow = squares_of_narrow_e(own, k, &most);
        if (bound <= NARROW || most <= NARROW) return narrow;
    }
    __m256i ee = _mm256_setzero_si256();
    for (int64_t j = BATCH; j < ENTRIES; j += AT_ONCE) {
        E_TERMS(own->with_x, _mm256_add_epi32, _mm256_sub_epi32)
        ee = with_squares(ee, e);
    }
    return ee;
}

/* 2 r, with either width of entries. */
#define R_TERMS(z, q, subtract, multiply)                                                        \
    __m256i q1 = LOAD(q, 1), bend = subtract(subtract(LOAD(q, 0), q1), subtract(q1, LOAD(q, 2)));\
    __m256i r = subtract(multiply(m, subtract(LOAD(z, 0), LOAD(z, 2))), bend);

/* Squares of 2 r. */
static int64_t squares_of_r(const whole *own, int64_t k) {
    double lag = (double)k;
    __m256i rr = _mm256_setzero_si256();
    if (own->bend * lag * lag * lag <= NARROW) {
        __m256i m = _mm256_set1_epi16((int16_t)(k * own->stride));
        for (int64_t j = BATCH; j < ENTRIES;) {
            __m256i sum = _mm256_setzero_si256();
            for (int i = 0; i < AT_MOST; i++, j += 2 * AT_ONCE) {
                R_TERMS(own->z_low, own->q_low, _mm256_sub_epi16, _mm256_mullo_epi16)
                sum = _mm256_add_epi32(sum, _mm256_madd_epi16(r, r));
            }
            rr = with_narrow(rr, sum);
        }
    } else {
        __m256i m = _mm256_set1_epi32((int32_t)(k * own->stride));
        for (int64_t j = BATCH; j < ENTRIES; j += AT_ONCE) {
            R_TERMS(own->z, own->q, _mm256_sub_epi32, _mm256_mullo_epi32)
            rr = with_squares(rr, r);
        }
    }
    return total_of(rr);
}
#undef LOAD

/* Bound of w of a lag; those of d and h are twice and four times as large. */
static inline double largest_rise(const whole *own, int64_t k) {
    double rise = (double)k * own->steepest;
    return rise < own->range ? rise : own->range;
}

/* Whether w, d and h of a lag fit in 16 bits. */
static inline int is_narrow(const whole *own, int64_t k) { return 4.0 * largest_rise(own, k) <= NARROW; }

/* Add the overlapping terms that end in the new entries; return 0, having added nothing, where
   doubles would round. */
static int whole_overlap(const whole *own, int64_t k, double *total) {
    __m256i phase[3], ee = squares_of_e(own, k, 4.0 * largest_rise(own, k));
    double of_r = (double)squares_of_r(own, k);
    squares_of_phase(own, k, is_narrow(own, k), phase);
    lanes sums = (lanes)totals_of(phase[0], phase[1], phase[2], ee);
    if (sums[3] >= LARGEST_SUM || of_r >= LARGEST_SUM) return 0;
    total[OSTDEV_MOMENTS] += (double)BATCH;
    total[OSTDEV_MOMENTS + 1] += (double)own->rises[k];
    add_four(total + OSTDEV, (__m256d)sums);
    total[PDEV] += 0.25 * of_r;
    if (k == 1) {
        total[STDEV_MOMENTS] += (double)BATCH;
        total[STDEV_MOMENTS + 1] += (double)own->rises[k];
        total[STDEV] += sums[0];
        total[ADEV] += sums[1];
        total[HDEV] += sums[2];
    }
    return 1;
}

/* Gather each k-th of the new entries from `first` on, and three before them; return how many. Of a
   power of two they are every second of what was gathered of `half`, but for the first. */
static int64_t gather_apart(const whole *own, int64_t first, int64_t k, const int16_t *half, int16_t *room) {
    int64_t n = first < ENTRIES ? (ENTRIES - first + k - 1) / k : 0;
    const int16_t *from = own->x_low + first - 3 * k;
    if (half != NULL) {
        room[0] = from[0];
        for (int64_t i = 0; i < n + 2; i++) room[i + 1] = half[2 * i];
        return n;
    }
    for (int64_t i = 0; i < n + 3; i++) room[i] = from[i * k];
    return n;
}

/* Add the terms that end at n entries that were gathered, in which the phase rose by `rise`. Where they
   fill no register the rest of it holds anything, and is masked. */
static void whole_apart(const int16_t *room, int64_t n, int64_t rise, double *total) {
    static const int16_t ones[4 * AT_ONCE] = {-1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1};
    __m256i ww = _mm256_setzero_si256(), dd = ww, hh = ww;
#define LOAD(lags) _mm256_loadu_si256((const __m256i *)(room + j + 3 - (lags)))
    for (int64_t j = 0; j < n; j += 2 * AT_ONCE) {
        int64_t missing = 2 * AT_ONCE - least(n - j, 2 * AT_ONCE);
        __m256i mask = _mm256_loadu_si256((const __m256i *)(ones + missing));
        PHASE_TERMS(LOAD, _mm256_sub_epi16)
        w = _mm256_and_si256(w, mask), d = _mm256_and_si256(d, mask), h = _mm256_and_si256(h, mask);
        ww = with_narrow(ww, _mm256_madd_epi16(w, w));
        dd = with_narrow(dd, _mm256_madd_epi16(d, d));
        hh = with_narrow(hh, _mm256_madd_epi16(h, h));
    }
#undef LOAD
    total[STDEV_MOMENTS] += (double)n;
    total[STDEV_MOMENTS + 1] += (double)rise;
    add_four(total + STDEV, totals_of(ww, dd, hh, _mm256_setzero_si256()));
}

/* Add all terms that end in the new entries, of which `before` came before; bit t of the masks tells
   that those of lag t are there, overlapping or apart. */
static void add_whole(
    const whole *own, int64_t before, const int64_t *lags, int64_t count, double *sums,
    uint64_t *overlapping, uint64_t *apart) {
    int16_t rooms[MOST_GATHERED];
    int64_t gathered[LONGEST_LAG], rises[LONGEST_LAG], used = 0, power = lags[0];
    const int16_t *half = own->x_low + BATCH - 3;
    for (int64_t t = 0; t < count; t++)
        if (whole_overlap(own, lags[t], sums + t * WIDTH)) *overlapping |= (uint64_t)1 << t;
    *apart = *overlapping & (lags[0] == 1);
    /* All are gathered before the first is read: a register waits for what was stored in pieces. */
    for (int64_t t = lags[0] == 1; t < count && is_narrow(own, lags[t]); t++) {
        int64_t k = lags[t], start = BATCH - 1 + k - before % k;
        int follows = lags[0] == 1 && k == 2 * power;
        gathered[t] = gather_apart(own, start, k, follows ? half : NULL, rooms + used);
        if (follows) half = rooms + used, power = k;
        rises[t] = 0;
        if (gathered[t] > 0) {
            uint32_t last = (uint32_t)own->x[start + (gathered[t] - 1) * k];
            rises[t] = (int32_t)(last - (uint32_t)own->x[start - k]);
        }
        used += gathered[t] + 3;
        *apart |= (uint64_t)1 << t;
    }
    const int16_t *room = rooms;
    for (int64_t t = lags[0] == 1; t < count && *apart >> t & 1; t++) {
        whole_apart(room, gathered[t], rises[t], sums + t * WIDTH);
        room += gathered[t] + 3;
    }
}

/* The same of a full rung of doubles. */
static void spend_whole(
    const double *rung, int64_t before, int64_t stride, const int64_t *lags, int64_t count, sizes *known,
    double *sums, uint64_t *overlapping, uint64_t *apart) {
    places room;
    whole own = whole_at(&room, 0, stride);
    if (to_whole(rung, lags[count - 1], known, &room, &own))
        add_whole(&own, before, lags, count, sums, overlapping, apart);
}

#else /* Doubles give the same bits. */

static void spend_whole(
    const double *rung, int64_t before, int64_t stride, const int64_t *lags, int64_t count, sizes *known,
    double *sums, uint64_t *overlapping, uint64_t *apart) {
    (void)rung, (void)before, (void)stride, (void)lags, (void)count, (void)known, (void)sums, (void)overlapping, (void)apart;
}

#endif
