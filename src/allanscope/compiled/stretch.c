/* Many batches of the low rungs in whole numbers: `cascade.c` takes them for what a device counts.

   The low rungs do nearly all of the work, and to keep their entries as doubles costs as much as most
   terms: sums of doubles wait for each other longer, frames are moved, entries are carried from one
   frame to another, and made whole numbers in the end. Modulo 2^32 no frame has to move, and what a
   rung hands up is every second entry. So as long as these rungs keep their offsets their doubles are
   left alone, and written once at the end, with the bits that they would have. */

enum { LOW_RUNGS = 3, ALIGNED = BATCH << LOW_RUNGS, LONGEST_STRETCH = 1 << 17 };

#if defined(__AVX2__)

/* A rung in whole numbers, in the frame that it had when the stretch began. */
typedef struct {
    places in;
    int64_t at; /* where the next new entry lies; BATCH entries of history come before */
    int64_t stride;
    sizes known;            /* of the history */
    double lowest, highest; /* of the phase in the history, seen from its last entry */
    int64_t due;            /* entries with which the next mark is done */
} low_rung;

/* Samples, from the next one on, that may be taken in so: those before the next batch whose number is a
   power of two. */
static int64_t undisturbed(const ladder *l, int64_t n, int64_t taken) {
    int64_t number = taken / ALIGNED, many = least(n, LONGEST_STRETCH) / ALIGNED, power = 1;
    if (taken % ALIGNED || number == 0 || l->levels <= LOW_RUNGS) return 0;
    while (power <= number) power *= 2;
    many = least(many, power - 1 - number);
    return many > 0 ? many * ALIGNED : 0;
}

/* How many rungs from the lowest on are whole numbers that are small enough for their terms. */
static int64_t fit_rungs(const ladder *l, int64_t axis, double anchor) {
    for (int64_t level = 0; level < LOW_RUNGS; level++) {
        double stride = ldexp(1.0, (int)level), zero = anchor + *offset_of(l, axis, level);
        sizes *known = &l->known[axis % GROUP][level];
        whole bounds = {.stride = (int64_t)1 << level};
        if (known->step < 0.0) *known = sizes_of(rung_of(l, axis, level), stride, 2, BATCH);
        int is_whole = zero == floor(zero) && anchor == floor(anchor) && fabs(zero) < 1e6;
        if (!is_whole || !find_bounds(*known, *known, l->lags[l->first[level + 1] - 1], &bounds)) return level;
    }
    return LOW_RUNGS;
}

static int64_t fit_rungs_of_all(const ladder *l, int64_t first, int64_t many, const double *anchor) {
    int64_t fit = LOW_RUNGS;
    for (int64_t a = first; a < first + many && fit > 0; a++) fit = least(fit, fit_rungs(l, a, anchor[a]));
    return fit;
}

/* Entries, more than so many, with which the next mark of a rung is done. */
static int64_t next_due(const ladder *l, int64_t level, int64_t entries) {
    int64_t due = INT64_MAX;
    for (const int64_t *mark = l->marks + level * l->slots, *end = mark + l->slots; mark < end; mark++)
        if (*mark >= 0 && done_at(*mark, level) > entries) due = least(due, done_at(*mark, level));
    return due;
}

/* Take the history of a rung of doubles. As small as its steps are, nothing in it is far from its
   origin. */
static void begin_low(const ladder *l, int64_t axis, int64_t level, low_rung *to) {
    double range;
    to->due = next_due(l, level, 0);
    to->at = BATCH, to->stride = (int64_t)1 << level, to->known = l->known[axis % GROUP][level];
    whole_entries(rung_of(l, axis, level), to->stride, 0, BATCH, &to->in, &range);
    to->lowest = to->highest = 0.0;
    for (int64_t j = 0; j < BATCH; j++) {
        double x = (double)(int32_t)((uint32_t)to->in.x[j] - (uint32_t)to->in.x[BATCH - 1]);
        if (x < to->lowest) to->lowest = x;
        if (x > to->highest) to->highest = x;
    }
}

/* Running sums of eight numbers. */
static inline __m256i running(__m256i v) {
    v = _mm256_add_epi32(v, _mm256_slli_si256(v, 4));
    v = _mm256_add_epi32(v, _mm256_slli_si256(v, 8));
    __m256i low_half = _mm256_permute2x128_si256(v, v, 0x08); /* where the high one is, else nothing */
    return _mm256_add_epi32(v, _mm256_shuffle_epi32(low_half, 0xFF));
}

static inline __m256i last_of(__m256i v) { return _mm256_permutevar8x32_epi32(v, _mm256_set1_epi32(7)); }

/* Sum a batch of samples up, eight at a time: each sum has the ones before it from the left. */
static void take_in_whole(const int16_t *rows, int64_t axes, int32_t zero, low_rung *to) {
    int32_t *xs = to->in.x + to->at, *zs = to->in.z + to->at, *qs = to->in.q + to->at;
    __m256i x = _mm256_set1_epi32(xs[-1]), z = _mm256_set1_epi32(zs[-1]), q = _mm256_set1_epi32(qs[-1]);
    for (int64_t j = 0; j < BATCH; j += AT_ONCE, rows += AT_ONCE * axes) {
        const int16_t *r = rows;
        __m128i eight = _mm_set_epi16(
            r[7 * axes], r[6 * axes], r[5 * axes], r[4 * axes], r[3 * axes], r[2 * axes], r[axes], r[0]);
        __m256i y = _mm256_sub_epi32(_mm256_cvtepi16_epi32(eight), _mm256_set1_epi32(zero));
        x = _mm256_add_epi32(last_of(x), running(y));
        __m256i x_before = _mm256_sub_epi32(x, y);
        z = _mm256_add_epi32(last_of(z), running(x_before));
        q = _mm256_add_epi32(last_of(q), running(_mm256_sub_epi32(_mm256_add_epi32(z, z), x_before)));
        _mm256_storeu_si256((__m256i *)(xs + j), x);
        _mm256_storeu_si256((__m256i *)(zs + j), z);
        _mm256_storeu_si256((__m256i *)(qs + j), q);
    }
}

/* Find the parts of the new entries that terms take besides. */
static void complete(low_rung *of) {
    int64_t at = of->at;
    const int32_t *x = of->in.x + at, *z = of->in.z + at, *q = of->in.q + at;
    int32_t *y = of->in.with_x + at;
    int16_t *x_low = of->in.x_low + at, *z_low = of->in.z_low + at, *q_low = of->in.q_low + at;
    int16_t *y_low = of->in.with_x_low + at;
    int is_lowest = of->stride == 1;
    for (int32_t j = 0; j < BATCH; j++) y[j] = (int32_t)((uint32_t)z[j] + (is_lowest ? (uint32_t)x[j] : 0));
    for (int32_t j = 0; j < BATCH; j++) x_low[j] = (int16_t)x[j];
    for (int32_t j = 0; j < BATCH; j++) z_low[j] = (int16_t)z[j];
    for (int32_t j = 0; j < BATCH; j++) q_low[j] = (int16_t)q[j];
    for (int32_t j = 0; j < BATCH; j++) y_low[j] = (int16_t)y[j];
}

static inline int32_t raised(int32_t most, uint32_t of) {
    int32_t size = (int32_t)of < 0 ? -(int32_t)of : (int32_t)of;
    return size > most ? size : most;
}

/* What `sizes_of` says, and the range of the phase as seen from the last entry of the history. A step
   of 16 bits an each of at most four samples: nothing of it leaves 32 bits. */
static sizes sizes_of_low(const low_rung *of, int32_t *lowest, int32_t *highest) {
    const uint32_t *x = (const uint32_t *)of->in.x + of->at, *z = (const uint32_t *)of->in.z + of->at;
    const uint32_t *q = (const uint32_t *)of->in.q + of->at, origin = x[-1], stride = (uint32_t)of->stride;
    int32_t step = 0, curve = 0, rest = 0, low = 0, high = 0;
    for (int32_t j = 0; j < BATCH; j++) {
        int32_t here = (int32_t)(x[j] - origin);
        step = raised(step, x[j] - x[j - 1]);
        low = here < low ? here : low, high = here > high ? here : high;
    }
    for (int32_t j = 0; j < BATCH && stride > 1; j++) {
        curve = raised(curve, (z[j] - z[j - 1]) - (z[j - 1] - z[j - 2]));
        rest = raised(rest, q[j] - q[j - 1] - stride * (z[j] + z[j - 1]));
    }
    *lowest = low, *highest = high;
    return (sizes){(double)step, (double)curve, 0.5 * (double)rest};
}

/* Write each `apart`-th entry of a rung from number `first` on as doubles, in the frame of the last
   entry of its history. Whatever they are modulo 2^32, what lies between two is small, and summed up. */
static void as_doubles(const low_rung *from, int64_t first, int64_t apart, double *rung) {
    const int64_t origin = BATCH - 1, s = from->stride * apart, at = from->at - BATCH;
    const uint32_t *x = (const uint32_t *)from->in.x + at, *z = (const uint32_t *)from->in.z + at;
    const uint32_t *q = (const uint32_t *)from->in.q + at, step = (uint32_t)s;
    int64_t xs[ENTRIES], zs[ENTRIES], qs[ENTRIES], own_x = 0, own_z = 0, own_q = 0; /* q twice */
    xs[first] = zs[first] = qs[first] = 0;
    for (int64_t j = first, k = j + apart; k < ENTRIES; j = k, k += apart) {
        own_q += 2 * s * own_z + s * s * own_x + (int32_t)(q[k] - q[j] - 2 * step * z[j] - step * step * x[j]);
        own_z += s * own_x + (int32_t)(z[k] - z[j] - step * x[j]);
        own_x += (int32_t)(x[k] - x[j]);
        xs[k] = own_x, zs[k] = own_z, qs[k] = own_q;
    }
    int64_t x0 = xs[origin], z0 = zs[origin], q0 = qs[origin];
    for (int64_t j = first; j < ENTRIES; j += apart) {
        int64_t time = from->stride * (j - origin);
        rung[j] = (double)(xs[j] - x0);
        rung[ENTRIES + j] = (double)(zs[j] - z0 - time * x0);
        rung[2 * ENTRIES + j] = 0.5 * (double)(qs[j] - q0 - 2 * time * z0 - time * time * x0);
    }
}

/* Note the marks whose last term has come: it takes the phase alone, which is near its origin. */
static void note_low_marks(ladder *l, int64_t axis, int64_t level, int64_t before, low_rung *own) {
    const uint32_t *x = (const uint32_t *)own->in.x + own->at - BATCH, origin = x[BATCH - 1];
    double *rung = rung_of(l, axis, level);
    if (own->due > before + BATCH) return;
    for (int32_t j = 0; j < ENTRIES; j++) rung[j] = (double)(int32_t)(x[j] - origin);
    note_marks(l, axis, level, before, BATCH, 0);
    own->due = next_due(l, level, before + BATCH);
}

/* Add all terms that end in the new entries, of which `before` came before. */
static void spend_low(const ladder *l, int64_t axis, int64_t level, int64_t before, low_rung *own) {
    const int64_t *lags = l->lags + l->first[level], count = l->first[level + 1] - l->first[level];
    uint64_t overlapping = 0, apart = 0, all = ~(uint64_t)0 >> (64 - count);
    whole terms = whole_at(&own->in, own->at - BATCH, own->stride);
    int32_t lowest, highest;
    double *sums = sums_of(l, axis, l->first[level]);
    complete(own);
    sizes new = sizes_of_low(own, &lowest, &highest);
    terms.range = larger((double)highest, own->highest) + larger(-(double)lowest, -own->lowest);
    if (find_bounds(own->known, new, lags[count - 1], &terms)) {
        find_rises(&terms);
        add_whole(&terms, before, lags, count, sums, &overlapping, &apart);
    }
    if (overlapping != all || apart != all) {
        double rung[3 * ENTRIES], stride = (double)own->stride;
        as_doubles(own, 0, 1, rung);
        for (int64_t t = 0; t < count; t++, overlapping >>= 1, apart >>= 1) {
            double *total = sums + t * WIDTH;
            if (!(overlapping & 1)) full_overlap(rung, BATCH, BATCH, lags[t], stride, total);
            if (!(apart & 1)) no_overlap(rung, before, ENTRIES, lags[t], total);
        }
    }
    double moved = (double)(int32_t)((uint32_t)own->in.x[own->at + BATCH - 1] - (uint32_t)own->in.x[own->at - 1]);
    own->known = new, own->lowest = (double)lowest - moved, own->highest = (double)highest - moved;
}

/* Every second of sixteen numbers, and what is `more` times a count above them. */
static inline void put_above(const int32_t *from, __m256i more, __m256i count, int32_t *to) {
    __m256 low = _mm256_castsi256_ps(entries_at(from)), high = _mm256_castsi256_ps(entries_at(from + AT_ONCE));
    __m256i both = _mm256_castps_si256(_mm256_shuffle_ps(low, high, _MM_SHUFFLE(3, 1, 3, 1)));
    both = _mm256_permute4x64_epi64(both, _MM_SHUFFLE(3, 1, 2, 0));
    _mm256_storeu_si256((__m256i *)to, _mm256_add_epi32(both, _mm256_mullo_epi32(more, count)));
}

/* Hand every second new entry up: `passed` samples of the stretch came before them, and samples there
   lie `more` above those here. With sums of 1, i and i^2 over the samples before it is what `with_offset`
   adds, from `passed` on. */
static void hand_up_low(const low_rung *from, int64_t half, int64_t passed, int64_t more, low_rung *to) {
    const int32_t *x = from->in.x + from->at, *z = from->in.z + from->at, *q = from->in.q + from->at;
    int64_t at = to->at + half, squares = (passed - 1) * passed / 2 * (2 * passed - 1) / 3;
    const __m256i m = _mm256_set1_epi32((int32_t)more), t = _mm256_set1_epi32((int32_t)passed);
    const __m256i first = _mm256_set1_epi32((int32_t)(passed * (passed - 1) / 2));
    const __m256i second = _mm256_set1_epi32((int32_t)squares), one = _mm256_set1_epi32(1);
    const __m256i third = _mm256_set1_epi32((int32_t)0xAAAAAAABu); /* modulo 2^32, of a multiple of 3 */
    const __m256i stride = _mm256_set1_epi32((int32_t)to->stride);
    __m256i s = _mm256_mullo_epi32(_mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 8), stride);
    for (int64_t j = 0; j < BATCH / 2; j += AT_ONCE) {
        __m256i i = _mm256_srli_epi32(_mm256_mullo_epi32(s, _mm256_sub_epi32(s, one)), 1);
        __m256i ii = _mm256_mullo_epi32(_mm256_sub_epi32(_mm256_add_epi32(s, s), one), third);
        __m256i ts = _mm256_mullo_epi32(t, s), ti = _mm256_mullo_epi32(t, _mm256_add_epi32(ts, _mm256_add_epi32(i, i)));
        ii = _mm256_add_epi32(_mm256_mullo_epi32(i, ii), ti);
        put_above(x + 2 * j, m, _mm256_add_epi32(t, s), to->in.x + at + j);
        put_above(z + 2 * j, m, _mm256_add_epi32(_mm256_add_epi32(first, ts), i), to->in.z + at + j);
        put_above(q + 2 * j, m, _mm256_add_epi32(second, ii), to->in.q + at + j);
        s = _mm256_add_epi32(s, _mm256_slli_epi32(stride, 3));
    }
}

/* Let what is new be the history. */
static void pass_low(low_rung *of) {
    places *in = &of->in;
    of->at += BATCH;
    if (of->at + BATCH <= ROOM) return;
    int64_t from = of->at - BATCH;
#define TO_FRONT(values) memcpy(values, (values) + from, BATCH * sizeof *(values))
    TO_FRONT(in->x), TO_FRONT(in->z), TO_FRONT(in->q), TO_FRONT(in->with_x);
    TO_FRONT(in->x_low), TO_FRONT(in->z_low), TO_FRONT(in->q_low), TO_FRONT(in->with_x_low);
#undef TO_FRONT
    of->at = BATCH;
}

/* Take in n samples of one axis, a multiple of ALIGNED, with the lowest `fit` rungs in whole numbers. */
static void take_in_stretch(
    ladder *l, int64_t axis, int64_t fit, const int16_t *rows, int64_t n, int64_t taken, double anchor) {
    low_rung rungs[LOW_RUNGS];
    int32_t zero = (int32_t)(anchor + *offset_of(l, axis, 0));
    for (int64_t level = 0; level < fit; level++) begin_low(l, axis, level, &rungs[level]);
    for (int64_t done = 0; done < n; done += BATCH) {
        take_in_whole(rows + axis + done * l->axes, l->axes, zero, &rungs[0]);
        int64_t batches = (taken + done) / BATCH + 1, level = 0;
        for (int full = 1; full && level < fit; level++, batches /= 2) {
            low_rung *own = &rungs[level];
            int64_t before = (batches - 1) * BATCH;
            int is_last = done + BATCH == n, is_highest = level + 1 == fit;
            double *rung = rung_of(l, axis, level);
            note_low_marks(l, axis, level, before, own);
            spend_low(l, axis, level, before, own);
            /* Handed up is every second entry; at the end all are. */
            if (is_last || is_highest) as_doubles(own, BATCH - 1, is_last ? 1 : 2, rung);
            if (is_highest) {
                promote(l, axis, level, before, BATCH);
            } else {
                double more = *offset_of(l, axis, level) - *offset_of(l, axis, level + 1);
                hand_up_low(own, before / 2 % BATCH, (before << level) - taken, (int64_t)more, own + 1);
            }
            if (is_last) make_history(rung, (double)own->stride);
            pass_low(own);
            full = batches % 2 == 0;
            if (full && is_highest) spend_batches(l, axis, fit, batches / 2);
        }
    }
    for (int64_t level = 0; level < fit; level++) l->known[axis % GROUP][level] = rungs[level].known;
}

/* Take in what can be taken so for axes from `first` on; return how many samples these are. */
static int64_t stretch_int16(
    ladder *l, int64_t first, int64_t many, const int16_t *rows, int64_t n, int64_t taken,
    const double *anchor) {
    int64_t length = undisturbed(l, n, taken), fit = length ? fit_rungs_of_all(l, first, many, anchor) : 0;
    if (fit == 0) return 0;
    for (int64_t a = first; a < first + many; a++) take_in_stretch(l, a, fit, rows, length, taken, anchor[a]);
    return length;
}

#else /* Doubles give the same bits. */

static int64_t stretch_int16(
    ladder *l, int64_t first, int64_t many, const int16_t *rows, int64_t n, int64_t taken,
    const double *anchor) {
    (void)l, (void)first, (void)many, (void)rows, (void)n, (void)taken, (void)anchor;
    return 0;
}

#endif

/* Samples of other types are not known to be whole numbers. */
static int64_t stretch_float64(
    ladder *l, int64_t first, int64_t many, const double *rows, int64_t n, int64_t taken,
    const double *anchor) {
    (void)l, (void)first, (void)many, (void)rows, (void)n, (void)taken, (void)anchor;
    return 0;
}
