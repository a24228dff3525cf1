/* The instructions of a function, each for a block of points at once; `vectors.py` makes them and defines the
   operations' numbers.

   A place holds one number for each of `width` points, a multiple of LANES. An instruction is four integers: operation,
   the places that it reads (the second is ignored where there is one operand), and the place that it writes. FAST is for
   operations that act on whole registers, DO for functions of single numbers. */

typedef double Lanes __attribute__((vector_size(8 * LANES)));
#define FAST(operation, value) case operation: for (long l = 0; l < width / LANES; l++) Z[l] = value; break;
#define DO(operation, value) case operation: for (long l = 0; l < width; l++) z[l] = value; break;

static void instructions(const int32_t *code, long steps, double *places, long width) {
    for (; steps--; code += 4) {
        const double *x = places + code[1] * width, *y = places + code[2] * width;
        double *z = places + code[3] * width;
        const Lanes *X = (const Lanes *)x, *Y = (const Lanes *)y;
        Lanes *Z = (Lanes *)z;
        switch (code[0]) {
            FAST(OP_ASSIGN, X[l])
            FAST(OP_ADD, X[l] + Y[l])
            FAST(OP_SUB, X[l] - Y[l])
            FAST(OP_MUL, X[l] * Y[l])
            FAST(OP_DIV, X[l] / Y[l])
            FAST(OP_NEG, -X[l])
            FAST(OP_SQ, X[l] * X[l])
            DO(OP_INV, 1 / x[l])
            FAST(OP_TWICE, X[l] + X[l])
            DO(OP_SQRT, sqrt(x[l]))
            DO(OP_POW, pow(x[l], y[l]))
            DO(OP_CONSTPOW, pow(x[l], y[l]))
            DO(OP_EXP, exp(x[l]))
            DO(OP_EXPM1, expm1(x[l]))
            DO(OP_LOG, log(x[l]))
            DO(OP_LOG1P, log1p(x[l]))
            DO(OP_SIN, sin(x[l]))
            DO(OP_COS, cos(x[l]))
            DO(OP_TAN, tan(x[l]))
            DO(OP_ASIN, asin(x[l]))
            DO(OP_ACOS, acos(x[l]))
            DO(OP_ATAN, atan(x[l]))
            DO(OP_ATAN2, atan2(x[l], y[l]))
            DO(OP_SINH, sinh(x[l]))
            DO(OP_COSH, cosh(x[l]))
            DO(OP_TANH, tanh(x[l]))
            DO(OP_ASINH, asinh(x[l]))
            DO(OP_ACOSH, acosh(x[l]))
            DO(OP_ATANH, atanh(x[l]))
            DO(OP_HYPOT, hypot(x[l], y[l]))
            DO(OP_FABS, fabs(x[l]))
            DO(OP_SIGN, (x[l] > 0) - (x[l] < 0))
            DO(OP_COPYSIGN, copysign(x[l], y[l]))
            DO(OP_FLOOR, floor(x[l]))
            DO(OP_CEIL, ceil(x[l]))
            DO(OP_FMOD, fmod(x[l], y[l]))
            DO(OP_FMIN, fmin(x[l], y[l]))
            DO(OP_FMAX, fmax(x[l], y[l]))
            DO(OP_LT, x[l] < y[l])
            DO(OP_LE, x[l] <= y[l])
            DO(OP_EQ, x[l] == y[l])
            DO(OP_NE, x[l] != y[l])
            DO(OP_NOT, x[l] == 0)
            DO(OP_AND, x[l] != 0 && y[l] != 0)
            DO(OP_OR, x[l] != 0 || y[l] != 0)
            DO(OP_IF_ELSE_ZERO, x[l] != 0 ? y[l] : 0)
        }
    }
}

/* Evaluate `blocks` times `width` points. Arguments and results are arrays (points, sizes[i]), arguments first, whose
   entries have the places from `first` on. */
void program_run(const int32_t *code, long steps, double *places, long width, long blocks, long first, long inputs,
                 long all, const long *sizes, double *const *arrays) {
    for (long block = 0; block < blocks; block++) {
        double *place = places + first * width;
        for (long i = 0; i < inputs; i++) {
            const double *from = arrays[i] + block * width * sizes[i];
            for (long j = 0; j < sizes[i]; j++, place += width)
                for (long l = 0; l < width; l++) place[l] = from[l * sizes[i] + j];
        }
        instructions(code, steps, places, width);
        for (long i = inputs; i < all; i++) {
            double *to = arrays[i] + block * width * sizes[i];
            for (long j = 0; j < sizes[i]; j++, place += width)
                for (long l = 0; l < width; l++) to[l * sizes[i] + j] = place[l];
        }
    }
}
