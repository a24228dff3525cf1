/* Banded linear algebra on windows of LOCAL neighbouring control points, and the interior-point loop of `interior`.

   A symmetric band (N, w) is kept by columns: entry (c + o, c) at [c, o]. An unknown is control point times n plus
   joint. A window begins at control point `first`, which may lie outside [0, N / n): what is outside is pinned and is
   left out. Functions without `static` are called from `quadratic.py`. `interior.py` states the same loop in NumPy,
   defines the constants in capitals, and says what they mean. */

typedef struct { /* the matrix A of constraints; see `quadratic.Constraints` */
    I n, one, wide, placed, places, border;
    const I *first, *joint, *wide_first, *place, *place_first;
    const double *coefficient, *wide_value, *gradient, *basis, *edge;
    double *scratch; /* (places, n, n) */
    const double *by_site; /* (sites, LOCAL, n): coefficients of the first sites n rows, see `sites_of`; unset outside */
    I sites;
} Matrix;
typedef struct { /* where bounds are: of N + k unknowns, of constraints with a floor, and with a ceiling */
    I size, lows, highs;
    I *low, *high;
} Bounds;

/* A factor keeps its columns `stride` apart. Column c begins at row c / 8 * 8, so that the same rows of neighbouring
   columns are at multiples of eight doubles, and loops run in whole blocks of eight; zeros are above the diagonal and
   behind the band. Columns of zeros, the inverse of the diagonal and `solve`'s vector come behind the columns. */
static I stride_of(I width) { return (width + 14) / 8 * 8; }
static I padded(I size) { return (size + 7) / 8 * 8; }
static I factor_size(I size, I width) { return padded(size) * (stride_of(width) + 2) + width + 24; }
static double *aligned(double *x) { return (double *)(((uintptr_t)x + 63) / 64 * 64); }

typedef double V __attribute__((vector_size(64), may_alias)); /* eight rows */

/* The Cholesky factor of a band into `f`; false where it is not positive definite. Four columns at a time act on four of
   those behind them, so that entries are loaded and stored once for four products. */
static bool factorise(const double *ab, I size, I width, double *f) {
    I stride = stride_of(width), length = stride / 8;
    memset(f, 0, factor_size(size, width) * sizeof(double));
    f = aligned(f);
    double *inverse = f + padded(size) * stride;
    for (I j = 0; j < size; j++)
        memcpy(f + j * stride + j % 8, ab + j * width, (width < size - j ? width : size - j) * sizeof(double));
    for (I j = 0; j < size; j += 4) {
        I block = 4 < size - j ? 4 : size - j, last = j + width + 3 < size ? j + width + 3 : size, row = j % 8;
        double *p = f + j * stride;
        for (I q = 0; q < block; q++) {
            double *own = p + q * stride, x = own[row + q];
            V *of = (V *)own;
            if (!(x > 0 && x < 1e300)) return false;
            x = inverse[j + q] = 1 / sqrt(x);
            for (I k = 0; k < row + q; k++) own[k] = 0;
            for (I k = 0; k < length; k++) of[k] *= x;
            for (I i = q + 1; i < block; i++) {
                V *to = of + (i - q) * length;
                double y = own[row + i];
                for (I k = 0; k < length; k++) to[k] -= y * of[k];
            }
        }
        for (I c = j + 4; c < last; c += 4) {
            I skipped = c / 8 * 8 - j / 8 * 8;
            const double *x = p + skipped + c % 8, *y = x + stride, *z = y + stride, *w = z + stride;
            const V *a = (const V *)(p + skipped), *b = a + length, *d = b + length, *e = d + length;
            V *to = (V *)(f + c * stride), *to_1 = to + length, *to_2 = to_1 + length, *to_3 = to_2 + length;
            for (I k = 0; k < (last - c / 8 * 8 + 7) / 8; k++) {
                V va = a[k], vb = b[k], vd = d[k], ve = e[k];
                to[k] -= x[0] * va + y[0] * vb + z[0] * vd + w[0] * ve;
                to_1[k] -= x[1] * va + y[1] * vb + z[1] * vd + w[1] * ve;
                to_2[k] -= x[2] * va + y[2] * vb + z[2] * vd + w[2] * ve;
                to_3[k] -= x[3] * va + y[3] * vb + z[3] * vd + w[3] * ve;
            }
        }
    }
    return true;
}

/* Solve with a factor, in place, x (N,), four rows at a time. */
static void solve(double *f, I size, I width, double *x) {
    I stride = stride_of(width), length = stride / 8, count = padded(size);
    f = aligned(f);
    const double *inverse = f + count * stride;
    double *at = f + count * (stride + 1);
    memcpy(at, x, size * sizeof(double));
    for (I j = 0; j < size; j += 4) {
        I row = j % 8;
        const double *p = f + j * stride, *q = p + stride, *r = q + stride, *by = inverse + j;
        const V *a = (const V *)p, *b = a + length, *c = b + length, *d = c + length;
        double *of = at + j, y = of[0] * by[0], z = (of[1] - p[row + 1] * y) * by[1];
        double w = (of[2] - p[row + 2] * y - q[row + 2] * z) * by[2];
        double v = (of[3] - p[row + 3] * y - q[row + 3] * z - r[row + 3] * w) * by[3];
        V *to = (V *)(of - row);
        for (I k = 0; k < length; k++) to[k] -= y * a[k] + z * b[k] + w * c[k] + v * d[k];
        of[0] = y;
        of[1] = z;
        of[2] = w;
        of[3] = v;
    }
    for (I j = (size + 3) / 4 * 4 - 4; j >= 0; j -= 4) {
        I row = j % 8;
        const double *p = f + j * stride, *q = p + stride, *r = q + stride, *by = inverse + j;
        const V *a = (const V *)p, *b = a + length, *c = b + length, *d = c + length;
        double *of = at + j, y = of[0], z = of[1], w = of[2], v = of[3];
        V *to = (V *)(of - row), sa = {0}, sb = {0}, sc = {0}, sd = {0};
        of[0] = of[1] = of[2] = of[3] = 0;
        for (I k = 0; k < length; k++) {
            sa += a[k] * to[k];
            sb += b[k] * to[k];
            sc += c[k] * to[k];
            sd += d[k] * to[k];
        }
        for (I l = 0; l < 8; l++) {
            y -= sa[l];
            z -= sb[l];
            w -= sc[l];
            v -= sd[l];
        }
        of[3] = v *= by[3];
        of[2] = w = (w - r[row + 3] * v) * by[2];
        of[1] = z = (z - q[row + 2] * w - q[row + 3] * v) * by[1];
        of[0] = (y - p[row + 1] * z - p[row + 2] * w - p[row + 3] * v) * by[0];
    }
    memcpy(x, at, size * sizeof(double));
}

/* The product of a symmetric band with x (N,). */
static void multiply(const double *ab, I size, I width, const double *x, double *out) {
    memset(out, 0, size * sizeof(double));
    for (I c = 0; c < size; c++) {
        const double *p = ab + c * width;
        I m = width < size - c ? width : size - c;
        double s = p[0] * x[c], y = x[c];
        for (I o = 1; o < m; o++) {
            s += p[o] * x[c + o];
            out[c + o] += p[o] * y;
        }
        out[c] += s;
    }
}

/* What a node with window `first` adds to a band: L' C L, C (m, m) symmetric, L from the basis and its derivatives `b`
   (3, LOCAL); `half` (3 n, n) for its own use. It is built for usual n, so that loops over joints have known lengths. */
static inline void add_node(double *ab, I points, const double *restrict c, I m, const double *b, I first, I n,
                            double *restrict half) {
    I width = LOCAL * n;
    for (I a = 0; a < LOCAL; a++) {
        I row = first + a;
        if (row < 0 || row >= points) continue;
        double x = b[a], y = b[LOCAL + a], z = b[2 * LOCAL + a];
        for (I j = 0; j < 3 * n; j++)
            for (I i = 0; i < n; i++)
                half[j * n + i] = x * c[j * m + i] + y * c[j * m + n + i] + z * c[j * m + 2 * n + i];
        for (I d = 0; d <= a; d++) {
            I column = first + d;
            if (column < 0) continue;
            double x2 = b[d], y2 = b[LOCAL + d], z2 = b[2 * LOCAL + d];
            for (I j = 0; j < n; j++) {
                double *restrict to = ab + (column * n + j) * width + (row - column) * n - j;
                const double *h = half + j * n;
                for (I i = row == column ? j : 0; i < n; i++)
                    to[i] += x2 * h[i] + y2 * h[n * n + i] + z2 * h[2 * n * n + i];
            }
        }
    }
}

/* Add the sum over nodes of L' C L to a band: `blocks` C (count, m, m), m >= 3 n, Hessians by position and its first two
   derivatives; `local` (count, 3, LOCAL) values of the basis and its derivatives; `first` (count,) windows. */
void banded_add_nodes(double *ab, I size, const double *blocks, I count, I m, const double *local, const I *first, I n) {
    I points = size / n;
    double half[3 * n * n];
    for (I k = 0; k < count; k++) {
        const double *c = blocks + k * m * m, *b = local + k * 3 * LOCAL;
        if (n == 6) add_node(ab, points, c, m, b, first[k], 6, half);
        else if (n == 7) add_node(ab, points, c, m, b, first[k], 7, half);
        else add_node(ab, points, c, m, b, first[k], n, half);
    }
}

/* What a place with window `first` adds to a band: (B B') kron M, M (n, n) symmetric, B `basis` (LOCAL,). A column of the
   band holds all rows behind its diagonal one after the other, so loops run over them. */
static inline void add_place(double *ab, I points, const double *m, const double *basis, I first, I n) {
    I width = LOCAL * n, begin = first < 0 ? -first : 0, end = LOCAL < points - first ? LOCAL : points - first;
    double by_row[LOCAL * n];
    for (I j = 0; j < n; j++) {
        for (I a = begin; a < end; a++)
            for (I i = 0; i < n; i++) by_row[a * n + i] = basis[a] * m[j * n + i];
        for (I d = begin; d < end; d++) {
            double x = basis[d];
            const double *restrict from = by_row + d * n + j;
            double *restrict to = ab + ((first + d) * n + j) * width;
            for (I k = 0; k < (end - d) * n - j; k++) to[k] += x * from[k];
        }
    }
}

/* Add the sum over places of (B B') kron M to a band; `blocks` M (count, n, n) symmetric, `basis` B (count, LOCAL). */
void banded_add_places(double *ab, I size, const double *blocks, I count, const double *basis, const I *first, I n) {
    for (I k = 0; k < count; k++) add_place(ab, size / n, blocks + k * n * n, basis + k * LOCAL, first[k], n);
}

/* A function whose last argument is n, built for usual n, so that loops over joints have known lengths. */
#define FOR_JOINTS(n, f, ...) ((n) == 6 ? f(__VA_ARGS__, 6) : (n) == 7 ? f(__VA_ARGS__, 7) : f(__VA_ARGS__, n))

/* How many groups of n rows, from the first one on, act on the joints 0 ... n - 1 in one window. */
static I sites_of(const Matrix *a) {
    for (I r = 0; r < a->one; r++)
        if (a->joint[r] != r % a->n || a->first[r] != a->first[r - r % a->n]) return r / a->n;
    return a->one / a->n;
}

/* The rows at sites of A d. */
static inline void at_sites(const double *d, I points, const Matrix *a, double *restrict out, I n) {
    memset(out, 0, a->sites * n * sizeof(double));
    for (I k = 0; k < a->sites; k++)
        for (I i = 0; i < LOCAL; i++) {
            I c = a->first[k * n] + i;
            if (c >= 0 && c < points)
                for (I j = 0; j < n; j++) out[k * n + j] += a->by_site[(k * LOCAL + i) * n + j] * d[c * n + j];
        }
}

/* Add A' y of the rows at sites to `out`. */
static inline void back_from_sites(const double *y, I points, const Matrix *a, double *restrict out, I n) {
    for (I k = 0; k < a->sites; k++)
        for (I i = 0; i < LOCAL; i++) {
            I c = a->first[k * n] + i;
            if (c >= 0 && c < points)
                for (I j = 0; j < n; j++) out[c * n + j] += a->by_site[(k * LOCAL + i) * n + j] * y[k * n + j];
        }
}

/* Add A' diag(weight) A of the rows at sites to a band. The sums `to` (points, LOCAL, n) are by column, distance and
   joint, so that loops run over joints. */
static inline void square_of_sites(const double *weight, const Matrix *a, double *ab, I points, double *restrict to,
                                   I n) {
    memset(to, 0, points * LOCAL * n * sizeof(double));
    for (I k = 0; k < a->sites; k++) {
        const double *restrict v = a->by_site + k * LOCAL * n;
        for (I i = 0; i < LOCAL; i++) {
            I row = a->first[k * n] + i;
            if (row < 0 || row >= points) continue;
            double by_row[n];
            for (I j = 0; j < n; j++) by_row[j] = weight[k * n + j] * v[i * n + j];
            for (I d = row < i ? i - row : 0; d <= i; d++)
                for (I j = 0; j < n; j++) to[((row - i + d) * LOCAL + i - d) * n + j] += by_row[j] * v[d * n + j];
        }
    }
    for (I c = 0; c < points; c++)
        for (I o = 0; o < LOCAL && c + o < points; o++)
            for (I j = 0; j < n; j++) ab[(c * n + j) * LOCAL * n + o * n] += to[(c * LOCAL + o) * n + j];
}

/* The rows at places of A d, by way of the steps at places. */
static inline void at_places(const double *d, I points, const Matrix *a, double *restrict out, I n) {
    double *restrict at = a->scratch;
    memset(at, 0, a->places * n * sizeof(double));
    for (I k = 0; k < a->places; k++)
        for (I i = 0; i < LOCAL; i++) {
            I c = a->place_first[k] + i;
            if (c >= 0 && c < points)
                for (I j = 0; j < n; j++) at[k * n + j] += a->basis[k * LOCAL + i] * d[c * n + j];
        }
    for (I r = 0; r < a->placed; r++) {
        double s = 0;
        for (I j = 0; j < n; j++) s += a->gradient[r * n + j] * at[a->place[r] * n + j];
        out[r] = s;
    }
}

/* Add A' y of the rows at places to `out`; `y` (placed,). */
static inline void back_from_places(const double *y, I points, const Matrix *a, double *restrict out, I n) {
    double *restrict at = a->scratch;
    memset(at, 0, a->places * n * sizeof(double));
    for (I r = 0; r < a->placed; r++)
        for (I j = 0; j < n; j++) at[a->place[r] * n + j] += a->gradient[r * n + j] * y[r];
    for (I k = 0; k < a->places; k++)
        for (I i = 0; i < LOCAL; i++) {
            I c = a->place_first[k] + i;
            if (c >= 0 && c < points)
                for (I j = 0; j < n; j++) out[c * n + j] += a->basis[k * LOCAL + i] * at[k * n + j];
        }
}

/* Add A' diag(weight) A of the rows at places to a band; `weight` (placed,). */
static inline void square_of_places(const double *weight, const Matrix *a, double *ab, I points, I n) {
    memset(a->scratch, 0, a->places * n * n * sizeof(double));
    for (I r = 0; r < a->placed; r++) {
        double *restrict to = a->scratch + a->place[r] * n * n;
        const double *restrict v = a->gradient + r * n;
        for (I i = 0; i < n; i++) {
            double x = weight[r] * v[i];
            for (I j = 0; j < n; j++) to[i * n + j] += x * v[j];
        }
    }
    for (I k = 0; k < a->places; k++)
        add_place(ab, points, a->scratch + k * n * n, a->basis + k * LOCAL, a->place_first[k], n);
}

/* A d (R,), d (size + border,). */
void banded_times(const double *d, I size, const Matrix *a, double *out) {
    I n = a->n, points = size / n, wide = LOCAL * n, two = a->one + a->wide;
    FOR_JOINTS(n, at_sites, d, points, a, out);
    for (I r = a->sites * n; r < a->one; r++) {
        double s = 0;
        for (I i = 0; i < LOCAL; i++) {
            I c = a->first[r] + i;
            if (c >= 0 && c < points) s += a->coefficient[r * LOCAL + i] * d[c * n + a->joint[r]];
        }
        out[r] = s;
    }
    for (I r = 0; r < a->wide; r++) {
        I begin = a->wide_first[r] * n, end = wide < size - begin ? wide : size - begin;
        double s = 0;
        for (I i = begin < 0 ? -begin : 0; i < end; i++) s += a->wide_value[r * wide + i] * d[begin + i];
        out[a->one + r] = s;
    }
    FOR_JOINTS(n, at_places, d, points, a, out + two);
    for (I r = 0; r < two + a->placed; r++)
        for (I k = 0; k < a->border; k++) out[r] += a->edge[r * a->border + k] * d[size + k];
}

/* Add A' y to `out` (size + border,). */
static void back(const double *y, I size, const Matrix *a, double *out) {
    I n = a->n, points = size / n, wide = LOCAL * n, two = a->one + a->wide;
    FOR_JOINTS(n, back_from_sites, y, points, a, out);
    for (I r = a->sites * n; r < a->one; r++)
        for (I i = 0; i < LOCAL; i++) {
            I c = a->first[r] + i;
            if (c >= 0 && c < points) out[c * n + a->joint[r]] += a->coefficient[r * LOCAL + i] * y[r];
        }
    for (I r = 0; r < a->wide; r++) {
        I begin = a->wide_first[r] * n, end = wide < size - begin ? wide : size - begin;
        for (I i = begin < 0 ? -begin : 0; i < end; i++) out[begin + i] += a->wide_value[r * wide + i] * y[a->one + r];
    }
    FOR_JOINTS(n, back_from_places, y + two, points, a, out);
    for (I r = 0; r < two + a->placed; r++)
        for (I k = 0; k < a->border; k++) out[size + k] += a->edge[r * a->border + k] * y[r];
}

/* Add A' diag(weight) A to a matrix of band, border (size, k) and corner (k, k); for its own use `whole` (size + k,),
   `y` (R,) and `by_site` (size LOCAL,). */
static void add_square(const double *weight, const Matrix *a, double *ab, I size, double *edge, double *corner,
                       double *whole, double *y, double *by_site) {
    I n = a->n, points = size / n, wide = LOCAL * n, two = a->one + a->wide, rows = two + a->placed, count = a->border;
    FOR_JOINTS(n, square_of_sites, weight, a, ab, points, by_site);
    for (I r = a->sites * n; r < a->one; r++)
        for (I i = 0; i < LOCAL; i++) {
            I row = a->first[r] + i;
            double x = weight[r] * a->coefficient[r * LOCAL + i];
            if (row < 0 || row >= points || x == 0) continue;
            for (I j = 0; j <= i; j++) {
                I column = a->first[r] + j;
                if (column >= 0)
                    ab[(column * n + a->joint[r]) * wide + (row - column) * n] += x * a->coefficient[r * LOCAL + j];
            }
        }
    for (I r = 0; r < a->wide; r++) {
        I begin = a->wide_first[r] * n, end = wide < size - begin ? wide : size - begin;
        const double *v = a->wide_value + r * wide;
        for (I j = begin < 0 ? -begin : 0; j < end; j++) {
            double x = weight[a->one + r] * v[j];
            if (x != 0)
                for (I i = j; i < end; i++) ab[(begin + j) * wide + i - j] += x * v[i];
        }
    }
    FOR_JOINTS(n, square_of_places, weight + two, a, ab, points);
    for (I k = 0; k < count; k++) {
        for (I r = 0; r < rows; r++) y[r] = weight[r] * a->edge[r * count + k];
        memset(whole, 0, (size + count) * sizeof(double));
        back(y, size, a, whole);
        for (I i = 0; i < size; i++) edge[i * count + k] += whole[i];
        for (I j = 0; j < count; j++) corner[k * count + j] += whole[size + j];
    }
}

/* Write the Cholesky factor (lower) of a small dense matrix over it; false where it is not positive definite. */
static bool factorise_small(double *x, I size) {
    for (I j = 0; j < size; j++)
        for (I i = j; i < size; i++) {
            double s = x[i * size + j];
            for (I k = 0; k < j; k++) s -= x[i * size + k] * x[j * size + k];
            if (i == j && !(s > 0 && s < 1e300)) return false;
            x[i * size + j] = i == j ? sqrt(s) : s / x[j * size + j];
        }
    return true;
}

/* Solve with a factor of `factorise_small`, in place, y (size,). */
static void solve_small(const double *x, I size, double *y) {
    for (I i = 0; i < size; i++) {
        for (I k = 0; k < i; k++) y[i] -= x[i * size + k] * y[k];
        y[i] /= x[i * size + i];
    }
    for (I i = size - 1; i >= 0; i--) {
        for (I k = i + 1; k < size; k++) y[i] -= x[k * size + i] * y[k];
        y[i] /= x[i * size + i];
    }
}

/* A vector over all bounds: (d, -d, A d at floors, -A d at ceilings), of `moved` (d, A d). */
static void spread(const double *moved, const Bounds *b, double *out) {
    I size = b->size;
    for (I i = 0; i < size; i++) {
        out[i] = moved[i];
        out[size + i] = -moved[i];
    }
    for (I i = 0; i < b->lows; i++) out[2 * size + i] = moved[size + b->low[i]];
    for (I i = 0; i < b->highs; i++) out[2 * size + b->lows + i] = -moved[size + b->high[i]];
}

/* `by_row` (R,): what acts at floors and, times `sign`, at ceilings. */
static void by_constraint(const double *y, const Bounds *b, double sign, I rows, double *by_row) {
    memset(by_row, 0, rows * sizeof(double));
    for (I i = 0; i < b->lows; i++) by_row[b->low[i]] += y[2 * b->size + i];
    for (I i = 0; i < b->highs; i++) by_row[b->high[i]] += sign * y[2 * b->size + b->lows + i];
}

/* The transpose of `spread` after (d, A d). */
static void gather(const double *y, const Bounds *b, const Matrix *a, I rows, double *by_row, double *out) {
    for (I i = 0; i < b->size; i++) out[i] = y[i] - y[b->size + i];
    by_constraint(y, b, -1, rows, by_row);
    back(by_row, b->size - a->border, a, out);
}

/* The product of a bordered band with d (inner + k,). */
static void bordered(const double *ab, const double *edge, const double *corner, I inner, I width, I count,
                     const double *d, double *out) {
    multiply(ab, inner, width, d, out);
    for (I k = 0; k < count; k++) {
        double s = 0;
        for (I i = 0; i < inner; i++) {
            out[i] += edge[i * count + k] * d[inner + k];
            s += edge[i * count + k] * d[i];
        }
        for (I j = 0; j < count; j++) s += corner[k * count + j] * d[inner + j];
        out[inner + k] = s;
    }
}

/* The interior-point loop; see `interior.py` for what goes in. `given`: gradient, both bounds of the box (size,) each,
   floors and ceilings (R,) each, infinite for none; `trying`: as in `minimise`. Out: d (size,), multipliers `by_row`
   (R,), and `found`: sum of e, damping (in and out), steps, decrease of the cost. Returns 0, 1 where no damping makes the program convex, 2 where
   there is no memory. */
int banded_interior(const double *band_, const double *edge_, const double *corner_, const double *mass,
             const double *mass_corner, I width, I size, const double *given, const Matrix *matrix, double price,
             double tolerance, I trying, double *d) {
    Matrix own = *matrix, *a = &own;
    I count = a->border, inner = size - count, rows = a->one + a->wide + a->placed;
    const double *g = given, *low_box = g + size, *high_box = low_box + size, *floor_ = high_box + size;
    const double *ceiling = floor_ + rows;
    double *by_row = d + size, *found = by_row + rows, damping = found[1];
    I begin = 2 * size;
    double *work = calloc(14 * (begin + 2 * rows) + 5 * size + 4 * rows + 2 * inner * width + 3 * inner * count + 2 * count * count +
                              count + factor_size(inner, width) + (a->one + inner) * LOCAL, sizeof(double));
    if (!work) return 2;
    double *next = work;
#define TAKE(name, length) double *name = next; next += (length)
    TAKE(floors, rows); TAKE(ceilings, rows);
    Bounds bounds = {size, 0, 0, (I *)floors, (I *)ceilings}, *at = &bounds;
    for (I r = 0; r < rows; r++) {
        if (isfinite(floor_[r])) at->low[at->lows++] = r;
        if (isfinite(ceiling[r])) at->high[at->highs++] = r;
    }
    I total = begin + at->lows + at->highs, pairs = 2 * total - begin;
    TAKE(band, inner * width); TAKE(edge, inner * count); TAKE(corner, count * count);
    memcpy(band, band_, inner * width * sizeof(double));
    memcpy(edge, edge_, inner * count * sizeof(double));
    memcpy(corner, corner_, count * count * sizeof(double));
    TAKE(b, total); TAKE(t, total); TAKE(lam, total); TAKE(e, total); TAKE(room, total); TAKE(v, total);
    TAKE(weight, total); TAKE(s, total); TAKE(slope, total); TAKE(dt, total); TAKE(dl, total); TAKE(de, total);
    TAKE(to_t, total); TAKE(to_e, total);
    TAKE(change, size); TAKE(residual, size); TAKE(part, size); TAKE(whole, size); TAKE(moved, size + rows);
    TAKE(y, rows);
    TAKE(ab, inner * width); TAKE(edge_now, inner * count); TAKE(through, inner * count);
    TAKE(corner_now, count * count); TAKE(last, count); TAKE(factor, factor_size(inner, width));
    TAKE(coefficients, a->one * LOCAL); TAKE(squares, inner * LOCAL);
    I n = a->n;
    a->sites = sites_of(a);
    a->by_site = coefficients;
    for (I r = 0; r < a->sites * n; r++)
        for (I i = 0; i < LOCAL; i++) coefficients[(r / n * LOCAL + i) * n + r % n] = a->coefficient[r * LOCAL + i];
    memcpy(moved, low_box, size * sizeof(double));
    memcpy(moved + size, floor_, rows * sizeof(double));
    spread(moved, at, b);
    for (I i = 0; i < size; i++) b[size + i] = -high_box[i];
    for (I i = 0; i < at->highs; i++) b[begin + at->lows + i] = -ceiling[at->high[i]];
    double primal = 0;
    for (I i = 0; i < total; i++) {
        t[i] = larger(-b[i], i < begin ? BEGIN_BOX : BEGIN_ROW);
        lam[i] = BARRIER / t[i];
        room[i] = 1;
        if (i >= begin) {
            lam[i] = smaller(lam[i], price / 2);
            room[i] = price - lam[i];
            e[i] = BARRIER / room[i];
        }
        primal = larger(primal, fabs(e[i] - b[i] - t[i]));
    }
    for (I i = 0; damping > 0 && i < inner * width; i++) band[i] += damping * mass[i];
    for (I i = 0; damping > 0 && i < count * count; i++) corner[i] += damping * mass_corner[i];
    memset(d, 0, size * sizeof(double));
    gather(lam, at, a, rows, by_row, part);
    for (I i = 0; i < size; i++) residual[i] = g[i] - part[i];
    I steps = 0;
    for (; steps < STEPS; steps++) {
        double mu = 0, dual = 0, excess = 0;
        for (I i = begin; i < total; i++) excess += e[i];
        for (I i = 0; i < total; i++) mu += t[i] * lam[i];
        for (I i = begin; i < total; i++) mu += e[i] * room[i];
        mu /= pairs;
        for (I i = 0; i < size; i++) dual = larger(dual, fabs(residual[i]));
        if (mu < tolerance && dual < DUAL && primal < PRIMAL) break;
        if (trying && excess > HOPELESS && mu * pairs < price * excess) break;
        for (I i = 0; i < total; i++) weight[i] = 1 / (t[i] / lam[i] + e[i] / room[i]);
        while (true) {
            memcpy(ab, band, inner * width * sizeof(double));
            memcpy(edge_now, edge, inner * count * sizeof(double));
            memcpy(corner_now, corner, count * count * sizeof(double));
            for (I i = 0; i < inner; i++) ab[i * width] += weight[i] + weight[size + i];
            for (I i = inner; i < size; i++) corner_now[(i - inner) * (count + 1)] += weight[i] + weight[size + i];
            by_constraint(weight, at, 1, rows, by_row);
            add_square(by_row, a, ab, inner, edge_now, corner_now, whole, y, squares);
            bool good = factorise(ab, inner, width, factor);
            for (I k = 0; good && k < count; k++) { /* (k, inner): the border through the inverse of the band */
                for (I i = 0; i < inner; i++) through[k * inner + i] = edge_now[i * count + k];
                solve(factor, inner, width, through + k * inner);
            }
            for (I k = 0; good && k < count; k++)
                for (I j = 0; j < count; j++)
                    for (I i = 0; i < inner; i++)
                        corner_now[k * count + j] -= edge_now[i * count + k] * through[j * inner + i];
            if (good && factorise_small(corner_now, count)) break;
            double more = larger(LEAST_DAMPING, damping);
            damping += more;
            if (!(damping < MOST_DAMPING)) {
                free(work);
                return 1;
            }
            for (I i = 0; i < inner * width; i++) band[i] += more * mass[i];
            for (I i = 0; i < count * count; i++) corner[i] += more * mass_corner[i];
            bordered(band, edge, corner, inner, width, count, d, residual);
            gather(lam, at, a, rows, by_row, part);
            for (I i = 0; i < size; i++) residual[i] += g[i] - part[i];
        }
        double way = 0;
        for (int phase = 0; phase < 2; phase++) {
            if (phase) {
                double after = 0;
                for (I i = 0; i < total; i++) after += (t[i] + way * dt[i]) * (lam[i] + way * dl[i]);
                for (I i = begin; i < total; i++) after += (e[i] + way * de[i]) * (room[i] - way * dl[i]);
                double centre = mu * smaller(1, larger(pow(after / pairs / mu, 3), 1e-6));
                for (I i = 0; i < total; i++) {
                    to_t[i] = centre - dt[i] * dl[i];
                    to_e[i] = i < begin ? 0 : centre + de[i] * dl[i];
                }
            } else {
                memset(to_t, 0, 2 * total * sizeof(double));
            }
            for (I i = 0; i < total; i++) s[i] = weight[i] * (b[i] - v[i] + to_t[i] / lam[i] - to_e[i] / room[i]);
            gather(s, at, a, rows, by_row, change);
            for (I i = 0; i < size; i++) change[i] -= residual[i];
            for (I k = 0; k < count; k++) {
                last[k] = change[inner + k];
                for (I i = 0; i < inner; i++) last[k] -= through[k * inner + i] * change[i];
            }
            solve_small(corner_now, count, last);
            solve(factor, inner, width, change);
            for (I k = 0; k < count; k++) {
                change[inner + k] = last[k];
                for (I i = 0; i < inner; i++) change[i] -= through[k * inner + i] * last[k];
            }
            memcpy(moved, change, size * sizeof(double));
            banded_times(change, inner, a, moved + size);
            spread(moved, at, slope);
            double most = 1; /* the inverse of the share at which the first of t, lam, e, room becomes zero */
#pragma omp simd reduction(max : most)
            for (I i = 0; i < total; i++) {
                dl[i] = s[i] - weight[i] * slope[i];
                dt[i] = (to_t[i] - t[i] * dl[i]) / lam[i] - t[i];
                most = larger(most, larger(-dt[i] / t[i], -dl[i] / lam[i]));
            }
#pragma omp simd reduction(max : most)
            for (I i = begin; i < total; i++) {
                de[i] = (to_e[i] + e[i] * dl[i]) / room[i] - e[i];
                most = larger(most, larger(-de[i] / e[i], dl[i] / room[i]));
            }
            way = 1 / most;
        }
        way = smaller(1, CLOSE * way);
        primal *= 1 - way;
        for (I i = 0; i < size; i++) {
            residual[i] *= 1 - way;
            d[i] += way * change[i];
        }
        for (I i = 0; i < total; i++) v[i] += way * slope[i];
        for (I i = 0; i < total; i++) t[i] += way * dt[i];
        for (I i = 0; i < total; i++) lam[i] += way * dl[i];
        for (I i = begin; i < total; i++) e[i] += way * de[i];
        for (I i = begin; i < total; i++) room[i] = price - lam[i];
        if (way < STUCK && primal > PRIMAL) { /* the excesses take over what is missing */
            primal = 0;
            for (I i = 0; i < total; i++) {
                if (i >= begin) e[i] = larger(e[i], b[i] - v[i] + t[i]);
                primal = larger(primal, fabs(e[i] - b[i] + v[i] - t[i]));
            }
        }
    }
    for (I i = 0; i < total; i++) lam[i] = -lam[i];
    by_constraint(lam, at, -1, rows, by_row);
    found[0] = 0;
    for (I i = begin; i < total; i++) found[0] += e[i];
    found[1] = damping;
    found[2] = (double)steps;
    for (I i = 0; i < size; i++) d[i] = smaller(larger(d[i], low_box[i]), high_box[i]);
    bordered(band, edge, corner, inner, width, count, d, residual);
    found[3] = 0;
    for (I i = 0; i < size; i++) found[3] -= (g[i] + residual[i] / 2) * d[i];
    free(work);
    return 0;
}
