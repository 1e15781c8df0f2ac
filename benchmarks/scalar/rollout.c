/* The plain rollout of fit/cloth/rollout.py in C, a yardstick for Taichi's kernel: see benchmarks/scalar.py.

   LANES candidates side by side: 1 makes a vec a float, any other power of two one of the processor's vectors. For a
   panel whose threads run along the mesh, held by handles: no effect, no pull, no rest curvature, no friction. As
   there, x [m], v [m/s], f [N], slopes [1], stress [N/m times m^2], and ahead is x + tau v:

       fibres   t = (E + a |E| E + tau dE/dt) area k,  E = (u.u - 1)/2;  stress t u
       shear    t = (S + tau dS/dt) area G,  S = u.w;  t w to the samples across, t u to those down
       rates    dE/dt, dS/dt: differences between two steps, over the step
       bending  B (kappa + tau dkappa/dt), both from `ahead`: stencils at nodes and, mixed, the slopes across
       step     v <- ((1 - c dt/2) v + dt (f/m + g)) / (1 + c dt/2);  x <- x + dt v, without the kernel's compensation
                for rounding, which -ffast-math would take out

   Fibres, shear and bends within elements go by lines of four nodes, from sums and differences of both ends, as in
   fit/cloth/lines.py. Sources of all these: there, fit/cloth/rollout.py, fit/cloth/forces.py. */

#include <math.h>

#define INLINE static inline __attribute__((always_inline))
#define LINE 5   /* entries of a line of fibres in the arrays of nodes, the last one free, and of weights */
#define NODES 4  /* of a line; and fibre samples that a sample of shear or twist is interpolated from */
#define MANY 7   /* nodes of a bend between two elements */

#if LANES == 1
typedef float vec;
INLINE vec magnitude(vec a) { return fabsf(a); }
INLINE vec at_least(vec a, float b) { return a > b ? a : b; }
#else
typedef float vec __attribute__((vector_size(4 * LANES)));
typedef int bits __attribute__((vector_size(4 * LANES)));
INLINE vec magnitude(vec a) { return (vec)((bits)a & 0x7fffffff); }
INLINE vec at_least(vec a, float b)
{
    const bits above = a > b;
    return (vec)(((bits)a & above) | ((bits)((vec){0} + b) & ~above));
}
#endif

typedef vec vec3[3];

/* What benchmarks/scalar.py hands over: the same fields in the same order stand there. */
struct task {
    vec3 *x, *v, *ahead, *f, *slopes, *slopes_ahead;
    vec *strains, *shear_strains;
    vec3 *stress, *seen;
    const vec *path, *material, *inverse_mass;
    const int *fibre_at;
    const float *fibre_weights, *fibre_area;
    const int *shear_across, *shear_down;
    const float *shear_area, *between;
    const int *bend_nodes;
    const float *bend_weights;
    const int *bend_kind;
    const float *twist_scales, *unit_slopes, *values, *curvatures;
    const int *held;
    const float *shares;
    const int *point_first, *point_nodes;
    const float *point_weights;
    const int *frame_step;
    const float *frame_lag;
    int nodes, fibres, fibres_across, shears, few_bends, many_bends, twists, held_nodes, handles, points, point_kinds;
    int frames, settle_steps;
    float time_step, settle_damping;
};

/* Weighted sum over a stencil whose length the compiler knows. */
INLINE void sum(vec3 out, const vec3 *restrict y, const int *restrict at, const float *restrict weights, int count)
{
    for (int c = 0; c < 3; c++)
        out[c] = weights[0] * y[at[0]][c];
    for (int n = 1; n < count; n++)
        for (int c = 0; c < 3; c++)
            out[c] += weights[n] * y[at[n]][c];
}

INLINE void take(vec3 *restrict y, const vec3 in, const int *restrict at, const float *restrict weights, int count)
{
    for (int n = 0; n < count; n++)
        for (int c = 0; c < 3; c++)
            y[at[n]][c] -= weights[n] * in[c];
}

INLINE vec dot(const vec3 a, const vec3 b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* A field's slopes at the three samples of a line. */
INLINE void line_slopes(vec3 *restrict out, const vec3 *restrict y, const int *restrict at, const float *restrict w)
{
    for (int c = 0; c < 3; c++) {
        vec outer = y[at[3]][c] - y[at[0]][c], inner = y[at[2]][c] - y[at[1]][c];
        vec bulge = (y[at[0]][c] + y[at[3]][c]) - (y[at[1]][c] + y[at[2]][c]);
        vec even = w[2] * outer + w[3] * inner, odd = w[4] * bulge;
        out[0][c] = even - odd;
        out[1][c] = w[0] * outer + w[1] * inner;
        out[2][c] = even + odd;
    }
}

INLINE void push_line(vec3 *restrict f, const vec3 *restrict stress, const int *restrict at, const float *restrict w)
{
    for (int c = 0; c < 3; c++) {
        vec both = stress[0][c] + stress[2][c], bulge = w[4] * (stress[2][c] - stress[0][c]);
        vec outer = w[0] * stress[1][c] + w[2] * both, inner = w[1] * stress[1][c] + w[3] * both;
        f[at[0]][c] += outer - bulge;
        f[at[1]][c] += inner + bulge;
        f[at[2]][c] -= inner - bulge;
        f[at[3]][c] -= outer + bulge;
    }
}

INLINE void pull_fibres(const struct task *t, int begin, int end, int is_across, vec stiffness, vec delay,
                        vec stiffening)
{
    vec3 *restrict slopes = t->slopes, *restrict stress = t->stress;
    for (int e = begin; e < end; e += 3) {
        const int *at = t->fibre_at + LINE * (e / 3);
        const float *w = t->fibre_weights + LINE * (e / 3);
        line_slopes(slopes + e, t->x, at, w);
        if (is_across)
            line_slopes(t->slopes_ahead + e, t->ahead, at, w);
        for (int g = e; g < e + 3; g++) {
            vec strain = 0.5f * (dot(slopes[g], slopes[g]) - 1.0f);
            vec tension = (strain + stiffening * magnitude(strain) * strain + delay * (strain - t->strains[g])) *
                          (t->fibre_area[g] * stiffness);
            t->strains[g] = strain;
            for (int c = 0; c < 3; c++)
                stress[g][c] = tension * slopes[g][c];
        }
    }
}

/* Shear and twist at three samples that lie between the same four fibre samples across. */
INLINE void shear(const struct task *t, vec stiffness, vec delay, vec twist_stiffness)
{
    const float *v = t->values, *w = t->unit_slopes;
    const vec3 *restrict y = t->slopes;
    vec3 *restrict stress = t->stress;
    for (int e = 0; e < t->shears; e += 3) {
        const int *at = t->shear_across + NODES * e;
        const float *h = t->between + NODES * (e / 3 % 3);
        vec3 u[3], p[3], m[3];
        for (int c = 0; c < 3; c++) {
            vec both = y[at[0]][c] + y[at[3]][c], mid = y[at[1]][c] + y[at[2]][c];
            vec odd = v[4] * (y[at[3]][c] - y[at[0]][c]) + v[5] * (y[at[2]][c] - y[at[1]][c]);
            vec even = v[2] * both + v[3] * mid;
            u[0][c] = even - odd;
            u[1][c] = v[0] * both + v[1] * mid;
            u[2][c] = even + odd;
        }
        for (int g = 0; g < 3; g++) {
            const int *below = t->shear_down + NODES * (e + g);
            vec3 to_down, d;
            sum(d, y, below, h, NODES);
            vec strain = dot(u[g], d);
            vec tension = (strain + delay * (strain - t->shear_strains[e + g])) * (-t->shear_area[e + g] * stiffness);
            t->shear_strains[e + g] = strain;
            for (int c = 0; c < 3; c++) {
                p[g][c] = tension * d[c];
                to_down[c] = tension * u[g][c];
            }
            take(stress, to_down, below, h, NODES);
        }
        line_slopes(m, t->slopes_ahead, at, w);
        for (int g = 0; g < 3; g++)
            for (int c = 0; c < 3; c++)
                m[g][c] *= t->twist_scales[e + g] * t->twist_scales[e + g] * twist_stiffness;
        for (int c = 0; c < 3; c++) {
            vec both = p[0][c] + p[2][c], apart = p[2][c] - p[0][c];
            vec outer = v[0] * p[1][c] + v[2] * both, inner = v[1] * p[1][c] + v[3] * both;
            vec twisted = m[0][c] + m[2][c], bulge = w[4] * (m[2][c] - m[0][c]);
            vec rim = w[0] * m[1][c] + w[2] * twisted, core = w[1] * m[1][c] + w[3] * twisted;
            stress[at[0]][c] -= (outer - v[4] * apart) + (rim - bulge);
            stress[at[1]][c] -= (inner - v[5] * apart) + (core + bulge);
            stress[at[2]][c] -= (inner + v[5] * apart) - (core - bulge);
            stress[at[3]][c] -= (outer + v[4] * apart) - (rim + bulge);
        }
    }
}

/* Second derivatives at the two inner nodes of lines; stiffness: along rows, along columns, mixed. */
INLINE void bend_lines(const struct task *t, const vec *restrict stiffness)
{
    const float *w = t->curvatures;
    const vec3 *restrict y = t->ahead;
    vec3 *restrict f = t->f;
    for (int e = 0; e < t->few_bends; e += 2) {
        const int *at = t->bend_nodes + NODES * e;
        const float first = t->bend_weights[NODES * e], last = t->bend_weights[NODES * (e + 1)];
        const vec modulus = stiffness[t->bend_kind[e]], m0 = first * first * modulus, m1 = last * last * modulus;
        for (int c = 0; c < 3; c++) {
            vec even = w[0] * ((y[at[0]][c] + y[at[3]][c]) - (y[at[1]][c] + y[at[2]][c]));
            vec odd = w[1] * (y[at[3]][c] - y[at[0]][c]) + w[2] * (y[at[2]][c] - y[at[1]][c]);
            vec k0 = m0 * (even - odd), k1 = m1 * (even + odd);
            vec both = w[0] * (k0 + k1), outer = w[1] * (k1 - k0), inner = w[2] * (k1 - k0);
            f[at[0]][c] -= both - outer;
            f[at[1]][c] += both + inner;
            f[at[2]][c] += both - inner;
            f[at[3]][c] -= both + outer;
        }
    }
}

/* Second derivatives at the nodes between two elements. */
INLINE void bend(int count, const vec3 *restrict ahead, vec3 *restrict f, const int *restrict at,
                 const float *restrict weights, const int *restrict kind, const vec *restrict stiffness)
{
    for (int e = 0; e < count; e++, at += MANY, weights += MANY) {
        vec3 moment;
        sum(moment, ahead, at, weights, MANY);
        for (int c = 0; c < 3; c++)
            moment[c] *= stiffness[kind[e]];
        take(f, moment, at, weights, MANY);
    }
}

INLINE void resist(const struct task *t, float per_step)
{
    const vec *material = t->material;
    const vec delay = material[6] * per_step;
    const vec stiffness[3] = {material[4], material[3], material[5]};
    const int few = t->few_bends;

    pull_fibres(t, 0, t->fibres_across, 1, material[1], delay, material[9]);
    pull_fibres(t, t->fibres_across, t->fibres, 0, material[0], delay, material[9]);
    shear(t, material[2], delay, material[5]);
    for (int e = 0; e < t->fibres; e += 3)
        push_line(t->f, t->stress + e, t->fibre_at + LINE * (e / 3), t->fibre_weights + LINE * (e / 3));
    bend_lines(t, stiffness);
    bend(t->many_bends, t->ahead, t->f, t->bend_nodes + NODES * few, t->bend_weights + NODES * few,
         t->bend_kind + few, stiffness);
}

/* And clear the forces for the next step, and look ahead for its bends. */
INLINE void kick_and_drift(const struct task *t, vec rate)
{
    const float dt = t->time_step;
    const vec *gravity = t->material + 10, time = t->material[7];
    const vec give = 1.0f / (1.0f + 0.5f * dt * rate), keep = give * (1.0f - 0.5f * dt * rate), push = give * dt;
    const vec3 fall = {push * gravity[0], push * gravity[1], push * gravity[2]};
    vec3 *restrict x = t->x, *restrict v = t->v, *restrict f = t->f, *restrict ahead = t->ahead;
    for (int i = 0; i < t->nodes; i++) {
        const vec light = push * t->inverse_mass[i];
        for (int c = 0; c < 3; c++) {
            v[i][c] = keep * v[i][c] + (light * f[i][c] + fall[c]);
            x[i][c] += dt * v[i][c];
            ahead[i][c] = x[i][c] + time * v[i][c];
            f[i][c] = (vec){0};
        }
    }
}

/* Held nodes moved freely with the rest; put them where their handles are, with the handles' speed. */
INLINE void hold(const struct task *t, int row, int last_row)
{
    const float per_second = 1.0f / t->time_step;
    const vec *path = t->path + 3 * t->handles * row, *last = t->path + 3 * t->handles * last_row;
    for (int h = 0; h < t->held_nodes; h++) {
        const float *shares = t->shares + t->handles * h;
        vec *x = t->x[t->held[h]], *v = t->v[t->held[h]], *ahead = t->ahead[t->held[h]];
        for (int c = 0; c < 3; c++) {
            vec place = shares[0] * path[c], before = shares[0] * last[c];
            for (int k = 1; k < t->handles; k++) {
                place += shares[k] * path[3 * k + c];
                before += shares[k] * last[3 * k + c];
            }
            v[c] = (place - before) * per_second;
            x[c] = place;
            ahead[c] = place + t->material[7] * v[c];
        }
    }
}

INLINE void see(const struct task *t, int frame)
{
    for (int p = 0; p < t->points; p++) {
        vec3 place = {0};
        for (int n = t->point_first[p]; n < t->point_first[p + 1]; n++) {
            const float w = t->point_weights[t->point_kinds * n];
            const int i = t->point_nodes[n];
            for (int c = 0; c < 3; c++)
                place[c] += w * (t->x[i][c] + t->frame_lag[frame] * t->v[i][c]);
        }
        for (int c = 0; c < 3; c++)
            t->seen[t->points * frame + p][c] = place[c];
    }
}

void rollout(const struct task *t)
{
    int step = -t->settle_steps;
    for (int frame = 0; frame < t->frames; frame++) {
        for (; step < t->frame_step[frame]; step++) {
            vec rate = t->material[8];
            if (step < 0)
                rate = at_least(rate, t->settle_damping);
            resist(t, step > -t->settle_steps ? 1.0f / t->time_step : 0.0f);
            kick_and_drift(t, rate);
            hold(t, step < 0 ? 0 : step + 1, step < 0 ? 0 : step);
        }
        see(t, frame);
    }
}
