/* Distances between the convex hulls of sets of points, by the algorithm of Gilbert, Johnson and Keerthi (1988); see
   `Clouds.apart`, which calls it. Follows `clouds.c`. */

#define ROUNDS 40
#define EXACT 1e-7      /* [m] error of a distance */
#define CORNERS 48      /* of an expanding polytope, which has fewer than twice as many faces */
#define FACES (2 * CORNERS)
#define DOUBTFUL 1e-5   /* [m] a search that stops with a larger error has failed */

typedef struct { /* up to four points of the difference of two hulls */
    double p[4][3];
    I size;
} Simplex;

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void minus(const double *a, const double *b, double *out) {
    for (I x = 0; x < 3; x++) out[x] = a[x] - b[x];
}

static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* The point nearest to the origin of the hull of a point, a segment or a triangle; only corners that it needs are kept.
   A face's nearest point is a mixture of its corners with weights >= 0, or it lies on an edge. */
static double nearest(Simplex *s, double *v) {
    const double *a = s->p[0], *b = s->p[1], *c = s->p[2];
    if (s->size == 1) {
        memcpy(v, a, 3 * sizeof(double));
        return dot(v, v);
    }
    if (s->size == 2) {
        double ab[3];
        minus(b, a, ab);
        double along = -dot(a, ab), length = dot(ab, ab);
        if (along >= length) memcpy(s->p[0], b, 3 * sizeof(double));
        if (along <= 0 || along >= length) {
            s->size = 1;
            return nearest(s, v);
        }
        for (I x = 0; x < 3; x++) v[x] = a[x] + along / length * ab[x];
        return dot(v, v);
    }
    double ab[3], ac[3], n[3], t[3];
    minus(b, a, ab);
    minus(c, a, ac);
    cross(ab, ac, n);
    double area = dot(n, n), share[3];
    cross(b, c, t);
    share[0] = dot(n, t);
    cross(c, a, t);
    share[1] = dot(n, t);
    cross(a, b, t);
    share[2] = dot(n, t);
    if (area > 1e-24 && share[0] > 0 && share[1] > 0 && share[2] > 0) {
        double height = dot(n, a) / area;
        for (I x = 0; x < 3; x++) v[x] = height * n[x];
        return dot(v, v);
    }
    Simplex best;
    double least = 1e300;
    for (I side = 0; side < 3; side++) {
        if (area > 1e-24 && share[side] > 0) continue;
        Simplex edge = {.size = 2};
        memcpy(edge.p[0], s->p[(side + 1) % 3], sizeof edge.p[0]);
        memcpy(edge.p[1], s->p[(side + 2) % 3], sizeof edge.p[1]);
        double at[3], square = nearest(&edge, at);
        if (square < least) {
            least = square;
            best = edge;
            memcpy(v, at, sizeof at);
        }
    }
    *s = best;
    return least;
}

/* The same for up to four points; 0 if the origin lies within a tetrahedron. */
static double nearest_of(Simplex *s, double *v) {
    if (s->size < 4) return nearest(s, v);
    Simplex best = *s;
    double least = 0;
    bool outside = false;
    for (I top = 0; top < 4; top++) {
        Simplex face = {.size = 3};
        for (I k = 0, at = 0; k < 4; k++)
            if (k != top) memcpy(face.p[at++], s->p[k], sizeof face.p[0]);
        double ab[3], ac[3], up[3], n[3], at[3];
        minus(face.p[1], face.p[0], ab);
        minus(face.p[2], face.p[0], ac);
        minus(s->p[top], face.p[0], up);
        cross(ab, ac, n);
        double side = dot(n, up), origin = -dot(n, face.p[0]);
        if (side * origin > 0 && fabs(side) > 1e-18) continue; /* the origin and the fourth point on the same side */
        double square = nearest(&face, at);
        if (!outside || square < least) {
            outside = true;
            least = square;
            best = face;
            memcpy(v, at, sizeof at);
        }
    }
    *s = best;
    return outside ? least : 0;
}

/* The point of a difference that goes least along n (3,), in the frame of b: min over a, less max over b. */
static void support(const Clouds *c, I a, I b, const double *turn, const double *shift, const double *n, double *height,
                    double *out) {
    double inward[3], back[3];
    for (I x = 0; x < 3; x++) {
        inward[x] = turn[x] * n[0] + turn[3 + x] * n[1] + turn[6 + x] * n[2];
        back[x] = -n[x];
    }
    I i = c->first[a] + lowest_of(c, a, inward, height), j = c->first[b] + lowest_of(c, b, back, height);
    double p[3] = {c->x[i], c->y[i], c->z[i]}, q[3] = {c->x[j], c->y[j], c->z[j]};
    for (I x = 0; x < 3; x++) out[x] = dot(turn + 3 * x, p) + shift[x] - q[x];
}

typedef struct { /* a face of a polytope around the origin: its corners, unit normal to the outside, and distance */
    I corner[3];
    double n[3], distance;
} Face;

/* A face through three of the points p; false if it has no area, or the origin lies beyond it. */
static bool face_of(double (*p)[3], I i, I j, I k, Face *out) {
    double ab[3], ac[3];
    minus(p[j], p[i], ab);
    minus(p[k], p[i], ac);
    cross(ab, ac, out->n);
    double area = sqrt(dot(out->n, out->n));
    if (!(area > 1e-14)) return false;
    for (I x = 0; x < 3; x++) out->n[x] /= area;
    out->corner[0] = i, out->corner[1] = j, out->corner[2] = k;
    out->distance = dot(out->n, p[i]);
    return out->distance > -EXACT;
}

/* Minus the depth [m] of the overlap of two hulls, by an expanding polytope (van den Bergen 2001) from a tetrahedron of
   their difference around the origin; NaN if it fails. `normal` as in `distance_of`. */
static double depth_of(const Clouds *c, I a, I b, const double *turn, const double *shift, const Simplex *s,
                       double *normal, double *height) {
    double p[CORNERS][3];
    Face face[FACES];
    I corners = 4, faces = 0, edge[FACES][2];
    memcpy(p, s->p, sizeof s->p);
    for (I top = 0; top < 4; top++) {
        I i = (top + 1) % 4, j = (top + 2) % 4, k = (top + 3) % 4;
        double ab[3], ac[3], up[3], n[3];
        minus(p[j], p[i], ab);
        minus(p[k], p[i], ac);
        minus(p[top], p[i], up);
        cross(ab, ac, n);
        bool good = dot(n, up) < 0 ? face_of(p, i, j, k, face + faces) : face_of(p, i, k, j, face + faces);
        if (!good) return NAN;
        faces++;
    }
    while (corners < CORNERS) {
        I best = 0, edges = 0, kept = 0;
        for (I f = 1; f < faces; f++)
            if (face[f].distance < face[best].distance) best = f;
        for (I x = 0; x < 3; x++) normal[x] = -face[best].n[x];
        double *w = p[corners], distance = face[best].distance;
        support(c, a, b, turn, shift, normal, height, w);
        double beyond = -dot(normal, w);
        if (beyond - distance < EXACT) return -beyond;
        for (I f = 0; f < faces; f++) { /* faces that the new corner sees go; their outer edges stay */
            if (dot(face[f].n, w) <= face[f].distance + 1e-12) {
                face[kept++] = face[f];
                continue;
            }
            for (I e = 0; e < 3; e++) {
                I i = face[f].corner[e], j = face[f].corner[(e + 1) % 3], twin = 0;
                while (twin < edges && !(edge[twin][0] == j && edge[twin][1] == i)) twin++;
                if (twin < edges) {
                    edges--;
                    edge[twin][0] = edge[edges][0], edge[twin][1] = edge[edges][1];
                } else if (edges < FACES) {
                    edge[edges][0] = i, edge[edges++][1] = j;
                }
            }
        }
        faces = kept;
        for (I e = 0; e < edges; e++)
            if (faces == FACES || !face_of(p, edge[e][0], edge[e][1], corners, face + faces++)) return NAN;
        corners++;
    }
    return NAN;
}

/* A lower bound [m] of the distance of the hulls of sets a and b, a's points turned and shifted into the frame of b. It
   is exact where it is below `reach`, minus the depth where they overlap; NaN where the search fails. `normal` (3,), from b towards a,
   is where the search begins, and shows the bound at the end. */
static double distance_of(const Clouds *c, I a, I b, const double *turn, const double *shift, double reach,
                          double *normal, double *height) {
    Simplex s = {.size = 0};
    double low = -1e300, upper = 1e300, n[3], v[3];
    memcpy(n, normal, sizeof n);
    for (I k = 0; k < ROUNDS; k++) {
        double *p = s.p[s.size];
        support(c, a, b, turn, shift, n, height, p);
        double bound = dot(n, p);
        if (bound > low) {
            low = bound;
            memcpy(normal, n, sizeof n);
        }
        if (low >= reach || upper - low < EXACT) return low;
        for (I i = 0; i < s.size; i++)
            if (!memcmp(s.p[i], p, 3 * sizeof(double))) return upper - low < DOUBTFUL ? low : NAN;
        s.size++;
        double before = upper;
        upper = sqrt(nearest_of(&s, v));
        if (upper < EXACT) return s.size == 4 ? depth_of(c, a, b, turn, shift, &s, normal, height) : NAN;
        if (upper >= before) return before - low < DOUBTFUL ? low : NAN;
        for (I x = 0; x < 3; x++) n[x] = v[x] / upper;
    }
    return upper - low < DOUBTFUL ? low : NAN;
}

typedef struct { /* convex pieces on links: their points with a radius around them, boxes, and faces of half-spaces */
    Clouds points;
    const I *link;                                /* (pieces,) */
    const double *radius, *middle, *half, *face;  /* (pieces,), (pieces, 3) each; a face is 0 where there is none */
} Pieces;

/* A product of a matrix (3, 3), or its transpose, and a vector. */
static void turned(const double *m, const double *v, double *out) {
    for (I x = 0; x < 3; x++) out[x] = dot(m + 3 * x, v);
}
static void turned_back(const double *m, const double *v, double *out) {
    for (I x = 0; x < 3; x++) out[x] = m[x] * v[0] + m[3 + x] * v[1] + m[6 + x] * v[2];
}

/* The distance [m] of pieces i and j, NaN if i is a half-space, as `distance_of` says; `normal` (3,) in the base frame, 0
   where none is known. Poses of links: `turns` (links, 3, 3), `at` (links, 3). */
static double between_hulls(const Pieces *s, const double *turns, const double *at, I i, I j, double reach, double *normal,
                            double *height) {
    const double *face = s->face + 3 * j, *ri = turns + 9 * s->link[i], *rj = turns + 9 * s->link[j];
    double between[3], turn[9], shift[3], n[3], from[3], around = s->radius[i] + s->radius[j];
    if (dot(s->face + 3 * i, s->face + 3 * i) > 0) return NAN;
    minus(at + 3 * s->link[i], at + 3 * s->link[j], between);
    if (dot(face, face) > 0) { /* a half-space: the lowest point over its plane */
        double inward[3];
        turned(rj, face, normal);
        turned_back(ri, normal, inward);
        I v = s->points.first[i] + lowest_of(&s->points, i, inward, height), w = s->points.first[j];
        double on[3] = {s->points.x[v], s->points.y[v], s->points.z[v]};
        double through[3] = {s->points.x[w], s->points.y[w], s->points.z[w]};
        return dot(inward, on) + dot(normal, between) - dot(face, through) - around;
    }
    for (I x = 0; x < 3; x++)
        for (I y = 0; y < 3; y++) turn[3 * x + y] = rj[x] * ri[y] + rj[3 + x] * ri[3 + y] + rj[6 + x] * ri[6 + y];
    turned_back(rj, between, shift);
    turned_back(rj, normal, n);
    if (!(dot(normal, normal) > 0)) { /* begin between the middles */
        turned(turn, s->middle + 3 * i, from);
        for (I x = 0; x < 3; x++) n[x] = from[x] + shift[x] - s->middle[3 * j + x];
        double length = sqrt(dot(n, n));
        for (I x = 0; x < 3; x++) n[x] = length > EXACT ? n[x] / length : x == 2;
    }
    double out = distance_of(&s->points, i, j, turn, shift, reach + around, n, height) - around;
    turned(rj, n, normal);
    return out;
}

/* `distance` (count, pairs): distances [m] of pieces a and b of pairs (pairs,) where they are below `reach`, elsewhere a
   lower bound that is not; NaN where it is not found. `normal` (count, pairs, 3), in the base frame, is the last one known
   (0: none), and the one found. Poses of links: rotation (count, links, 3, 3), origin (count, links, 3). `box`
   (pieces, 6) and `height` (largest set,) for its own use. */
void hulls_apart(const Pieces *s, const double *rotation, const double *origin, I count, I links, I pieces, const I *a,
                 const I *b, I pairs, double reach, double *box, double *height, double *normal, double *distance) {
    for (I k = 0; k < count; k++) {
        const double *turns = rotation + k * links * 9, *at = origin + k * links * 3;
        for (I i = 0; i < pieces; i++) { /* boxes along the axes of the base */
            const double *r = turns + 9 * s->link[i], *h = s->half + 3 * i;
            for (I x = 0; x < 3; x++) {
                double half = fabs(r[3 * x]) * h[0] + fabs(r[3 * x + 1]) * h[1] + fabs(r[3 * x + 2]) * h[2];
                double middle = dot(r + 3 * x, s->middle + 3 * i) + at[3 * s->link[i] + x];
                box[6 * i + x] = middle - half;
                box[6 * i + 3 + x] = middle + half;
            }
        }
        for (I p = 0; p < pairs; p++) {
            const double *x = box + 6 * a[p], *y = box + 6 * b[p], *face = s->face + 3 * b[p];
            double square = 0;
            for (I i = 0; i < 3 && !(dot(face, face) > 0); i++) {
                double gap = larger(larger(x[i] - y[3 + i], y[i] - x[3 + i]), 0);
                square += gap * gap;
            }
            double *d = distance + k * pairs + p, *n = normal + 3 * (k * pairs + p);
            *d = square < reach * reach ? between_hulls(s, turns, at, a[p], b[p], reach, n, height) : sqrt(square);
        }
    }
}

typedef struct { /* frames of links at configurations, and how joints move them */
    const double *rotation, *origin, *axis; /* (K, L + 1, 3, 3), (K, L + 1, 3), (K, L, 3) */
    const double *far, *reach;              /* (K, n), (K, L) how far joints go from there */
    const double *coupling;                 /* (L, n) */
    const bool *slides;                     /* (L,) */
    I joints, own;                          /* L, n */
} Motion;
typedef struct { /* pairs of bodies */
    const I *a, *b;        /* (P,) */
    const bool *moves;     /* (2, P, L) joints that move one body and not the other */
    const bool *planar;    /* (P,) a plane may bound the distance */
    const double *corners; /* (bodies, 8, 3) [m] of boxes, in the frames of links */
    const double *wanted;  /* (P,) [m] */
    I count;
} Pairs;

/* See `Scenery.travel`: how far points of a body, one side of a pair, move at most. `corner` (8, 3) in the base frame. */
static double travel_of(const Motion *m, const bool *moves, I k, const double *corner) {
    double moved = 0;
    for (I j = m->joints - 1; j >= 0; j--) {
        double far = m->reach[k * m->joints + j], most = 0;
        if (!moves[j] || !(far > 0)) continue;
        const double *axis = m->axis + 3 * (k * m->joints + j), *at = m->origin + 3 * (k * (m->joints + 1) + j);
        if (m->slides[j]) {
            moved += far;
            continue;
        }
        for (I c = 0; c < 8; c++) {
            double arm[3];
            minus(corner + 3 * c, at, arm);
            double along = dot(arm, axis);
            most = larger(most, dot(arm, arm) - along * along);
        }
        moved += far * (sqrt(most) + moved);
    }
    return moved;
}

/* See `least_heights` of `cell.proof`: the least height of hull i over hull j along n (3,), in the whole interval. */
static double height_of(const Pieces *s, const Motion *m, const bool *moves, I k, I i, I j, const double *n,
                        double bend, double *height, double *lever) {
    const double *turns = m->rotation + 9 * k * (m->joints + 1), *at = m->origin + 3 * k * (m->joints + 1);
    const double *ri = turns + 9 * s->link[i], *rj = turns + 9 * s->link[j], *oi = at + 3 * s->link[i];
    double up[3], back[3], between[3];
    turned_back(ri, n, up);
    turned_back(rj, n, back);
    memset(lever, 0, 4 * m->own * sizeof(double));
    for (I l = 0; l < m->joints; l++) {
        if (!moves[l]) continue;
        const double *axis = m->axis + 3 * (k * m->joints + l);
        double by[4] = {0, 0, 0, 0}, turn[3], arm[3];
        if (m->slides[l]) {
            by[3] = dot(axis, n);
        } else {
            cross(n, axis, turn);
            minus(oi, at + 3 * l, arm);
            by[3] = dot(turn, arm);
            turned_back(ri, turn, by);
        }
        for (I c = 0; c < m->own; c++)
            for (I x = 0; x < 4; x++) lever[4 * c + x] += m->coupling[l * m->own + c] * by[x];
    }
    I begin = s->points.first[i], count = s->points.first[i + 1] - begin;
    const double *restrict x = s->points.x + begin, *restrict y = s->points.y + begin, *restrict z = s->points.z + begin;
    for (I v = 0; v < count; v++) height[v] = up[0] * x[v] + up[1] * y[v] + up[2] * z[v];
    for (I c = 0; c < m->own; c++) {
        double share = m->far[k * m->own + c], *by = lever + 4 * c, p = by[0], q = by[1], r = by[2], level = by[3];
        for (I v = 0; v < count; v++) height[v] -= share * fabs(p * x[v] + q * y[v] + r * z[v] + level);
    }
    double low = height[0];
    for (I v = 1; v < count; v++) low = smaller(low, height[v]);
    begin = s->points.first[j], count = s->points.first[j + 1] - begin;
    double high = -1e300;
    for (I v = begin; v < begin + count; v++)
        high = larger(high, back[0] * s->points.x[v] + back[1] * s->points.y[v] + back[2] * s->points.z[v]);
    minus(oi, at + 3 * s->link[j], between);
    return dot(n, between) + low - high - s->radius[i] - s->radius[j] - bend;
}

/* Bounds of the distances of pairs of bodies within intervals, for cases (count,) of an interval `span` and a pair.
   `bound` [m] is what a pair keeps during the whole interval: the largest of those from boxes, hulls and planes; the
   next is tried where one is not above what is wanted. `distance` [m] of the hulls in the middle, less `error`; -inf
   where boxes suffice, NaN where it is not found. It is exact where it is below `least` [m], the smallest so far.
   `travel` [m] how far the bodies approach each other. `normal` (count, 3) as in `hulls_apart`. */
void hulls_within(const Pieces *s, const Pairs *p, const Motion *m, const I *span, const I *pair, I count, double error,
                  double rounding, double *least, double *height, double *lever, double *bound, double *distance,
                  double *travel, double *normal) {
    for (I c = 0; c < count; c++) {
        I k = span[c], q = pair[c], body[2] = {p->a[q], p->b[q]}, links = m->joints + 1;
        const double *turns = m->rotation + 9 * k * links, *at = m->origin + 3 * k * links, *known = s->face + 3 * body[1];
        double corner[2][24], low[2][3], high[2][3], square = 0, *n = normal + 3 * c;
        bool flat = dot(known, known) > 0;
        travel[c] = 0;
        for (I side = 0; side < 2; side++) {
            const double *r = turns + 9 * s->link[body[side]], *o = at + 3 * s->link[body[side]];
            for (I v = 0; v < 8; v++)
                for (I x = 0; x < 3; x++) {
                    double at_x = dot(r + 3 * x, p->corners + 24 * body[side] + 3 * v) + o[x];
                    corner[side][3 * v + x] = at_x;
                    low[side][x] = v ? smaller(low[side][x], at_x) : at_x;
                    high[side][x] = v ? larger(high[side][x], at_x) : at_x;
                }
            travel[c] += travel_of(m, p->moves + (side * p->count + q) * m->joints, k, corner[side]);
        }
        for (I x = 0; x < 3 && !flat; x++) {
            double gap = larger(larger(low[0][x] - high[1][x], low[1][x] - high[0][x]), 0);
            square += gap * gap;
        }
        bound[c] = sqrt(square) - travel[c];
        distance[c] = -INFINITY;
        if (bound[c] > p->wanted[q]) continue;
        if (dot(s->face + 3 * body[0], s->face + 3 * body[0]) > 0) {
            bound[c] = distance[c] = NAN;
            continue;
        }
        double need = p->wanted[q] + travel[c] + 2 * error;
        distance[c] = between_hulls(s, turns, at, body[0], body[1], larger(need, *least), n, height) - error;
        if (isnan(distance[c])) continue;
        *least = smaller(*least, distance[c] + error);
        bound[c] = larger(bound[c], distance[c] - travel[c]);
        if (bound[c] > p->wanted[q] || !p->planar[q]) continue;
        double turn = 0;
        const bool *moves = p->moves + q * m->joints;
        for (I j = 0; j < m->joints; j++)
            if (moves[j] && !m->slides[j]) turn += m->reach[k * m->joints + j];
        double bend = travel[c] * turn;
        if (distance[c] - bend > p->wanted[q])
            bound[c] = larger(bound[c], height_of(s, m, moves, k, body[0], body[1], n, bend, height, lever) - rounding);
    }
}
