/* Sets of points in space, many at a time; see `hulls.py`, which states the same in NumPy. Coordinates are kept apart,
   so that loops over the points of a set run over neighbours. */

typedef struct { /* sets of points: `first` (sets + 1,) where each begins */
    const double *x, *y, *z;
    const I *first;
} Clouds;

/* The point of set `which` that goes least along a direction (3,); all heights into `height`. */
static I lowest_of(const Clouds *c, I which, const double *direction, double *restrict height) {
    I begin = c->first[which], count = c->first[which + 1] - begin, out = 0;
    const double *restrict x = c->x + begin, *restrict y = c->y + begin, *restrict z = c->z + begin;
    double a = direction[0], b = direction[1], d = direction[2];
    for (I v = 0; v < count; v++) height[v] = a * x[v] + b * y[v] + d * z[v];
    for (I v = 1; v < count; v++)
        if (height[v] < height[out]) out = v;
    return out;
}

/* `vertex` and `least` (count,): the lowest point of each of the sets `which` (count,), and how high it is. */
void clouds_lowest(const Clouds *c, const I *which, const double *direction, I count, double *height, I *vertex,
                   double *least) {
    for (I m = 0; m < count; m++) {
        vertex[m] = lowest_of(c, which[m], direction + 3 * m, height);
        least[m] = height[vertex[m]];
    }
}

/* `vertex` (count, most): the lowest point of each, and where `many` more that are at most `above` higher, each at least
   `beside` from those before; -1 where there is none. `height` and `gap` (largest set,) for its own use. */
void clouds_spread(const Clouds *c, const I *which, const double *direction, const I *many, I count, I most,
                   double above, double beside, double *height, double *gap, I *vertex) {
    for (I m = 0; m < count; m++) {
        I begin = c->first[which[m]], size = c->first[which[m] + 1] - begin, *to = vertex + m * most;
        const double *restrict x = c->x + begin, *restrict y = c->y + begin, *restrict z = c->z + begin;
        I last = to[0] = lowest_of(c, which[m], direction + 3 * m, height);
        double low = height[last] + above;
        for (I k = 1; k < most; k++) to[k] = -1;
        if (!many[m]) continue;
        for (I v = 0; v < size; v++) gap[v] = height[v] <= low ? 1e300 : 0;
        for (I k = 1; k < most; k++) {
            I best = 0;
            for (I v = 0; v < size; v++) {
                double p = x[v] - x[last], q = y[v] - y[last], r = z[v] - z[last];
                gap[v] = smaller(gap[v], p * p + q * q + r * r);
            }
            for (I v = 1; v < size; v++)
                if (gap[v] > gap[best]) best = v;
            if (!(gap[best] > beside * beside)) break;
            to[k] = last = best;
        }
    }
}
