/* The plain rollout of fit/cloth/rollout.py in C, a yardstick for Taichi's kernel: see benchmarks/scalar.py.

   LANES candidates side by side: 1 makes a vec a float, any other power of two one of the processor's vectors. For a
   panel whose threads run along the mesh, held by handles: no effect, no pull, no rest curvature, no friction. As
   there, x [m], v [m/s], f [N], slopes [1], stress [N/m times m^2], and ahead is x + tau v:

       fibres   t = (E + a |E| E + tau dE/dt) area k,  E = (u.u - 1)/2;  stress t u
       shear    t = (S + tau dS/dt) area G,  S = u.w;  t w to the samples across, t u to those down
       rates    dE/dt, dS/dt: differences between two steps, over the step
       bending  B (kappa + tau dkappa/dt), both from `ahead`: stencils at nodes and, mixed, the slopes across
       step     v <- ((1 - c dt/2) v + dt (f/m + g)) / (1 + c dt/2);  x <- x + dt v

   Sources of these: fit/cloth/rollout.py, fit/cloth/forces.py. */

#include <math.h>

#define INLINE static inline __attribute__((always_inline))
#define FIBRE_NODES 4  /* of every fibre sample */
#define TIED 4         /* fibre samples that a sample of shear or twist is interpolated from */
#define FEW 4          /* nodes of a bend inside an element */
#define MANY 7         /* and of one between two elements */

#if LANES == 1
typedef float vec;
INLINE vec magnitude(vec a) { return fabsf(a); }
#else
typedef float vec __attribute__((vector_size(4 * LANES)));
typedef int bits __attribute__((vector_size(4 * LANES)));
INLINE vec magnitude(vec a) { return (vec)((bits)a & 0x7fffffff); }
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
    const float *shear_weights, *shear_area;
    const int *bend_nodes;
    const float *bend_weights;
    const int *bend_kind;
    const float *twist_weights;
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

INLINE void add(vec3 *restrict y, const vec3 in, const int *restrict at, const float *restrict weights, int count)
{
    for (int n = 0; n < count; n++)
        for (int c = 0; c < 3; c++)
            y[at[n]][c] += weights[n] * in[c];
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

INLINE void slopes_of(const vec3 *restrict y, vec3 *restrict out, const int *restrict at, const float *restrict weights,
                      int count)
{
    for (int e = 0; e < count; e++)
        sum(out[e], y, at + FIBRE_NODES * e, weights + FIBRE_NODES * e, FIBRE_NODES);
}

INLINE void pull_fibres(int begin, int end, const vec3 *restrict slopes, vec *restrict strains,
                        vec3 *restrict stress, const float *restrict area, vec stiffness, vec delay, vec stiffening)
{
    for (int e = begin; e < end; e++) {
        vec strain = 0.5f * (dot(slopes[e], slopes[e]) - 1.0f);
        vec tension = (strain + stiffening * magnitude(strain) * strain + delay * (strain - strains[e])) *
                      (area[e] * stiffness);
        strains[e] = strain;
        for (int c = 0; c < 3; c++)
            stress[e][c] = tension * slopes[e][c];
    }
}

INLINE void shear(int count, const vec3 *restrict slopes, vec *restrict strains, vec3 *restrict stress,
                  const int *restrict across, const int *restrict down, const float *restrict weights,
                  const float *restrict area, vec stiffness, vec delay)
{
    for (int e = 0; e < count; e++, across += TIED, down += TIED, weights += 2 * TIED) {
        vec3 u, w, to_across, to_down;
        sum(u, slopes, across, weights, TIED);
        sum(w, slopes, down, weights + TIED, TIED);
        vec strain = dot(u, w);
        vec tension = (strain + delay * (strain - strains[e])) * (area[e] * stiffness);
        strains[e] = strain;
        for (int c = 0; c < 3; c++) {
            to_across[c] = tension * w[c];
            to_down[c] = tension * u[c];
        }
        add(stress, to_across, across, weights, TIED);
        add(stress, to_down, down, weights + TIED, TIED);
    }
}

INLINE void twist(int count, const vec3 *restrict slopes_ahead, vec3 *restrict stress, const int *restrict across,
                  const float *restrict weights, vec stiffness)
{
    for (int e = 0; e < count; e++, across += TIED, weights += TIED) {
        vec3 moment;
        sum(moment, slopes_ahead, across, weights, TIED);
        for (int c = 0; c < 3; c++)
            moment[c] *= stiffness;
        add(stress, moment, across, weights, TIED);
    }
}

/* Second derivatives of one length; stiffness: along rows, along columns, mixed. */
INLINE void bend(int count, int length, const vec3 *restrict ahead, vec3 *restrict f, const int *restrict at,
                 const float *restrict weights, const int *restrict kind, const vec *restrict stiffness)
{
    for (int e = 0; e < count; e++, at += length, weights += length) {
        vec3 moment;
        sum(moment, ahead, at, weights, length);
        for (int c = 0; c < 3; c++)
            moment[c] *= stiffness[kind[e]];
        take(f, moment, at, weights, length);
    }
}

INLINE void resist(const struct task *t, float per_step)
{
    const vec *material = t->material;
    const vec stretch = material[0], stretch_across = material[1], delay = material[6] * per_step, stiffening = material[9];
    const vec stiffness[3] = {material[4], material[3], material[5]};
    const int few = t->few_bends;

    for (int i = 0; i < t->nodes; i++)
        for (int c = 0; c < 3; c++) {
            t->f[i][c] = (vec){0};
            t->ahead[i][c] = t->x[i][c] + material[7] * t->v[i][c];
        }
    slopes_of(t->x, t->slopes, t->fibre_at, t->fibre_weights, t->fibres);
    slopes_of(t->ahead, t->slopes_ahead, t->fibre_at, t->fibre_weights, t->fibres_across);
    pull_fibres(0, t->fibres_across, t->slopes, t->strains, t->stress, t->fibre_area, stretch_across, delay,
                stiffening);
    pull_fibres(t->fibres_across, t->fibres, t->slopes, t->strains, t->stress, t->fibre_area, stretch, delay,
                stiffening);
    shear(t->shears, t->slopes, t->shear_strains, t->stress, t->shear_across, t->shear_down, t->shear_weights,
          t->shear_area, material[2], delay);
    twist(t->twists, t->slopes_ahead, t->stress, t->shear_across, t->twist_weights, material[5]);
    for (int e = 0; e < t->fibres; e++)
        take(t->f, t->stress[e], t->fibre_at + FIBRE_NODES * e, t->fibre_weights + FIBRE_NODES * e, FIBRE_NODES);
    bend(few, FEW, t->ahead, t->f, t->bend_nodes, t->bend_weights, t->bend_kind, stiffness);
    bend(t->many_bends, MANY, t->ahead, t->f, t->bend_nodes + FEW * few, t->bend_weights + FEW * few,
         t->bend_kind + few, stiffness);
}

INLINE void kick_and_drift(int nodes, vec3 *restrict x, vec3 *restrict v, const vec3 *restrict f,
                           const vec *restrict inverse_mass, const vec *restrict gravity, vec rate, float dt)
{
    const vec keep = 1.0f - 0.5f * dt * rate, give = 1.0f / (1.0f + 0.5f * dt * rate);
    for (int i = 0; i < nodes; i++)
        for (int c = 0; c < 3; c++) {
            v[i][c] = (keep * v[i][c] + dt * (f[i][c] * inverse_mass[i] + gravity[c])) * give;
            x[i][c] += dt * v[i][c];
        }
}

/* Held nodes moved freely with the rest; put them where their handles are, with the speed that takes. */
INLINE void hold(const struct task *t, int row)
{
    const float dt = t->time_step;
    const vec *path = t->path + 3 * t->handles * row;
    for (int h = 0; h < t->held_nodes; h++) {
        const float *shares = t->shares + t->handles * h;
        vec *x = t->x[t->held[h]], *v = t->v[t->held[h]];
        for (int c = 0; c < 3; c++) {
            vec place = shares[0] * path[c];
            for (int k = 1; k < t->handles; k++)
                place += shares[k] * path[3 * k + c];
            v[c] = (place - (x[c] - dt * v[c])) * (1.0f / dt);
            x[c] = place;
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
                rate += t->settle_damping;
            resist(t, step > -t->settle_steps ? 1.0f / t->time_step : 0.0f);
            kick_and_drift(t->nodes, t->x, t->v, t->f, t->inverse_mass, t->material + 10, rate, t->time_step);
            hold(t, step < 0 ? 0 : step + 1);
        }
        see(t, frame);
    }
}
