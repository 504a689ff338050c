/* Quadratic program over the stages of a motion by a dual active-set method (Goldfarb and Idnani 1983):

       minimise  x'Hx / 2 + g'x + sum_j c_j s_j      H couples stages at most two apart
       so that   a_i'x = 0 for equations, a_i'x - s_part(i) <= b_i for the other rows, s >= 0,

   where a row has entries in two neighbouring stages. With H = L L', y = L'x and m_i = inverse(L) a_i, the rows that are
   active have the multipliers z of S z = M y0 - b, S = M M'. Rows that are violated become active, one after the other,
   until none is. Slack stays 0 until the multipliers of the rows of its part add up to its price; then it is free, and
   the part is said to yield. A small second derivative, SOFT of its price, keeps S regular. */

#include "native.h"

typedef struct {
    int64_t stages, width, equations, rows, parts; /* the equations are the first of the rows */
    int64_t most;              /* changes of the set of active rows after which it is given up */
    double tolerance;          /* violation of a row that is accepted */
    const double *blocks;      /* of H, (3, stages, width, width): of each stage with itself, the one before, that before */
    const double *gradient;    /* g, (stages, width) */
    const double *coefficients; /* a, in the stage before and in its own, (rows, 2 width) */
    const int64_t *stage, *part; /* of rows, (rows,); the part is -1 where there is no slack */
    const double *bound;       /* b, (rows,) */
    const double *price;       /* c, (parts,) */
    const uint8_t *likely;     /* 1 for rows that are likely to be active, 2 where the part is likely to yield, (rows,) */
    double *x, *slack;         /* out: (stages, width) and (parts,) */
    double *multipliers;       /* out: (rows,) */
    int64_t solved;            /* out: whether it is solved */
} StagedProgram;

#define SOFT 1e-4
#define SINGULAR 1e-11 /* least share of a pivot by which it is told from zero */
#define NEVER 1e300
#define MOST_ACTIVE 512
#define BEGINNINGS 12 /* sets of likely rows that are tried */

/* Everything that changes while a program is solved; rows that are active have slots in the order of their coming. */
typedef struct {
    int64_t n, band, active, room;
    double *factor; /* L by rows, (n, band + 1) */
    double *free_y, *scratch; /* y at the minimum under no constraint, (n,), and working memory, (room,) */
    double *vectors;    /* m of active rows, and of the one that comes, at their places, (room + 1, n) */
    double *products;   /* M M', (room, room) */
    double *chol;       /* of S, (room, room) */
    double *target, *z, *own, *rate; /* of active rows: m y0, multipliers; products with the one that comes, rates, (room,) */
    double *turned;        /* what is added to the factor of S, (room,) */
    double *loads, *rises; /* of parts: sums of multipliers, and their rates, (parts,) */
    double *excess;        /* of candidates: violation, (2 parts + stages,) */
    int64_t *candidate;    /* rows to enforce, or rows + part for its slack, or -1, (2 parts + stages,) */
    int64_t *row, *place;  /* of active rows and the one that comes: row and place of its vector, (room + 1,) */
    uint8_t *in, *yields;  /* whether a row is active, whether a part yields */
} Work;

#define WORTH 0.3 /* least violation of a candidate, as a share of the greatest */

static ALWAYS_INLINE double dot(const double *a, const double *b, int64_t n)
{
    double sum[8] = {0.0}, rest = 0.0;
    int64_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (int j = 0; j < 8; j++) sum[j] += a[i + j] * b[i + j];
    for (; i < n; i++) rest += a[i] * b[i];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7])) + rest;
}

static int64_t at_least(int64_t a, int64_t b) { return a > b ? a : b; }

static double *vector(const Work *w, int64_t slot) { return w->vectors + w->place[slot] * w->n; }

/* The row i of the factor, indexed by columns. */
static double *factor_row(const Work *w, int64_t i) { return w->factor + (i + 1) * w->band; }

WIDE static int factorise(const StagedProgram *q, Work *w)
{
    int64_t p = q->width, square = p * p;
    for (int64_t i = 0; i < w->n; i++) {
        int64_t stage = i / p, inside = i % p, first = at_least(0, (stage - 2) * p);
        double *own = factor_row(w, i);
        for (int64_t j = first; j <= i; j++) {
            int64_t other = j / p;
            double value = q->blocks[((stage - other) * q->stages + stage) * square + inside * p + j % p];
            int64_t from = at_least(first, (other - 2) * p);
            double *row = factor_row(w, j);
            double left = value - dot(own + from, row + from, j - from);
            if (j < i) own[j] = left / row[j];
            else if (!(left > SINGULAR * value)) return 0;
            else own[i] = sqrt(left);
        }
    }
    return 1;
}

/* Solve L y = v in place, where v is zero before an index. */
WIDE static void forward(const Work *w, int64_t width, double *v, int64_t from)
{
    for (int64_t i = from; i < w->n; i++) {
        int64_t first = at_least(from, (i / width - 2) * width);
        const double *row = factor_row(w, i);
        v[i] = (v[i] - dot(row + first, v + first, i - first)) / row[i];
    }
}

/* Solve L'x = v in place. */
WIDE static void backward(const Work *w, int64_t width, double *v)
{
    for (int64_t i = w->n - 1; i >= 0; i--) {
        const double *row = factor_row(w, i);
        double x = v[i] /= row[i];
        for (int64_t j = at_least(0, (i / width - 2) * width); j < i; j++) v[j] -= x * row[j];
    }
}

/* Cholesky factor of S from a slot on; whether it is regular. */
WIDE static int factorise_active(const StagedProgram *q, Work *w, int64_t from)
{
    for (int64_t i = from; i < w->active; i++) {
        double *own = w->chol + i * w->room;
        int64_t part = q->part[w->row[i]];
        int soft = part >= 0 && w->yields[part];
        for (int64_t j = 0; j <= i; j++) {
            double value = w->products[i * w->room + j];
            if (soft && q->part[w->row[j]] == part) value += 1.0 / (SOFT * q->price[part]);
            double *row = w->chol + j * w->room, left = value - dot(own, row, j);
            if (j < i) own[j] = left / row[j];
            else if (!(left > SINGULAR * value)) return 0;
            else own[i] = sqrt(left);
        }
    }
    return 1;
}

/* Solve S r = u in place. */
WIDE static void solve_active(const Work *w, double *u)
{
    for (int64_t i = 0; i < w->active; i++) {
        const double *row = w->chol + i * w->room;
        u[i] = (u[i] - dot(row, u, i)) / row[i];
    }
    for (int64_t i = w->active - 1; i >= 0; i--) {
        const double *row = w->chol + i * w->room;
        double r = u[i] /= row[i];
        for (int64_t j = 0; j < i; j++) u[j] -= r * row[j];
    }
}

/* Multipliers of the active rows, anew. */
static void settle(const StagedProgram *q, Work *w)
{
    for (int64_t i = 0; i < w->active; i++) {
        int64_t part = q->part[w->row[i]];
        w->z[i] = w->target[i] - q->bound[w->row[i]] + (part >= 0 && w->yields[part] ? 1.0 / SOFT : 0.0);
    }
    solve_active(w, w->z);
}

/* Fill the vector m of a row, into the place after the active ones, and its products with them. */
WIDE static void prepare(const StagedProgram *q, Work *w, int64_t row)
{
    int64_t p = q->width, stage = q->stage[row], from = at_least(0, stage - 1) * p;
    const double *a = q->coefficients + 2 * p * row;
    double *m = vector(w, w->active);
    memset(m, 0, (size_t)w->n * sizeof(double));
    if (stage > 0) memcpy(m + from, a, (size_t)p * sizeof(double));
    memcpy(m + stage * p, a + p, (size_t)p * sizeof(double));
    forward(w, p, m, from);
    for (int64_t i = 0; i < w->active; i++) w->own[i] = dot(vector(w, i) + from, m + from, w->n - from);
    w->own[w->active] = dot(m + from, m + from, w->n - from);
    w->target[w->active] = dot(m + from, w->free_y + from, w->n - from);
}

/* Make the prepared row an active one with a multiplier; whether S stays regular. */
static int join(const StagedProgram *q, Work *w, int64_t row, double z)
{
    int64_t slot = w->active++;
    memcpy(w->products + slot * w->room, w->own, (size_t)(slot + 1) * sizeof(double));
    w->row[slot] = row;
    w->z[slot] = z;
    w->in[row] = 1;
    return factorise_active(q, w, slot);
}

/* Take an active row out, without the factor of S; the prepared one moves with the others. */
static void take_out(Work *w, int64_t slot)
{
    int64_t last = --w->active, place = w->place[slot];
    w->in[w->row[slot]] = 0;
    for (int64_t i = slot; i < last; i++) {
        double *to = w->products + i * w->room, *from = to + w->room;
        memcpy(to, from, (size_t)slot * sizeof(double));
        memcpy(to + slot, from + slot + 1, (size_t)(i - slot + 1) * sizeof(double));
        w->row[i] = w->row[i + 1];
        w->z[i] = w->z[i + 1];
    }
    memmove(w->own + slot, w->own + slot + 1, (size_t)(last + 1 - slot) * sizeof(double));
    memmove(w->target + slot, w->target + slot + 1, (size_t)(last + 1 - slot) * sizeof(double));
    memmove(w->place + slot, w->place + slot + 1, (size_t)(last + 1 - slot) * sizeof(int64_t));
    w->place[last + 1] = place;
}

/* Factor of S after u u' is added to it, where u is zero before a slot, by a rotation for each further one. */
WIDE static void add_to_factor(Work *w, int64_t from, const double *u)
{
    double *scale = w->scratch, *share = w->rate;
    for (int64_t i = from; i < w->active; i++) {
        double *row = w->chol + i * w->room, left = u[i];
        for (int64_t k = from; k < i; k++) {
            row[k] = (row[k] + share[k] * left) / scale[k];
            left = scale[k] * left - share[k] * row[k];
        }
        double pivot = sqrt(row[i] * row[i] + left * left);
        scale[i] = pivot / row[i];
        share[i] = left / row[i];
        row[i] = pivot;
    }
}

/* Take an active row out; the column that it leaves is added to the factor of the rows after it. */
static void leave(Work *w, int64_t slot)
{
    double *column = w->turned;
    for (int64_t i = slot + 1; i < w->active; i++) {
        double *from = w->chol + i * w->room, *to = from - w->room;
        column[i - 1] = from[slot];
        memcpy(to, from, (size_t)slot * sizeof(double));
        memcpy(to + slot, from + slot + 1, (size_t)(i - slot) * sizeof(double));
    }
    take_out(w, slot);
    add_to_factor(w, slot, column);
}

static void propose(Work *w, int64_t at, int64_t which, double excess, double *most)
{
    if (!(excess > w->excess[at])) return;
    w->excess[at] = excess;
    w->candidate[at] = which;
    if (excess > *most) *most = excess;
}

/* Find the row of each part, and without slack of each stage, that is violated most, and slack that is negative; the
   greatest violation beyond the tolerance, or 0. */
WIDE static double find_violated(const StagedProgram *q, Work *w)
{
    int64_t p = q->width, parts = q->parts;
    double most = 0.0;
    memcpy(q->x, w->free_y, (size_t)w->n * sizeof(double));
    memset(w->loads, 0, (size_t)parts * sizeof(double));
    for (int64_t i = 0; i < w->active; i++) {
        const double *m = vector(w, i);
        double z = w->z[i];
        int64_t part = q->part[w->row[i]];
        if (part >= 0) w->loads[part] += z;
        for (int64_t k = at_least(0, q->stage[w->row[i]] - 1) * p; k < w->n; k++) q->x[k] -= z * m[k];
    }
    backward(w, p, q->x);
    for (int64_t i = 0; i < 2 * parts + q->stages; i++) {
        w->excess[i] = q->tolerance;
        w->candidate[i] = -1;
    }
    for (int64_t j = 0; j < parts; j++) {
        q->slack[j] = w->yields[j] ? (w->loads[j] - q->price[j]) / (SOFT * q->price[j]) : 0.0;
        propose(w, parts + j, q->rows + j, -q->slack[j], &most);
    }
    for (int64_t i = q->equations; i < q->rows; i++) {
        if (w->in[i]) continue;
        int64_t stage = q->stage[i], part = q->part[i];
        const double *a = q->coefficients + 2 * p * i;
        double value = stage > 0 ? dot(a, q->x + (stage - 1) * p, 2 * p) : dot(a + p, q->x, p);
        value -= q->bound[i] + (part >= 0 ? q->slack[part] : 0.0);
        propose(w, part >= 0 ? part : 2 * parts + stage, i, value, &most);
    }
    return most;
}

/* Change the factor of S after a part has begun or ceased to yield; whether S is regular. */
static int change_yield(const StagedProgram *q, Work *w, int64_t part, int yields)
{
    int64_t first = 0;
    w->yields[part] = (uint8_t)yields;
    while (first < w->active && q->part[w->row[first]] != part) first++;
    if (!yields) return factorise_active(q, w, first);
    double added = sqrt(1.0 / (SOFT * q->price[part]));
    for (int64_t i = first; i < w->active; i++) w->turned[i] = q->part[w->row[i]] == part ? added : 0.0;
    add_to_factor(w, first, w->turned);
    return 1;
}

/* Raise the multiplier of a candidate until it holds; whether that is possible. */
static int enforce(const StagedProgram *q, Work *w, int64_t which, int64_t *left)
{
    int is_row = which < q->rows;
    int64_t part = is_row ? q->part[which] : which - q->rows;
    double z = 0.0;
    if (is_row) prepare(q, w, which);
    while ((*left)-- > 0) {
        double soft = part >= 0 && w->yields[part] ? 1.0 / (SOFT * q->price[part]) : 0.0, load = z, length, over;
        length = soft + (is_row ? w->own[w->active] : 0.0);
        over = is_row ? w->target[w->active] - q->bound[which] - z * w->own[w->active] : 0.0;
        for (int64_t i = 0; i < w->active; i++) {
            int same = part >= 0 && q->part[w->row[i]] == part;
            if (same) load += w->z[i];
            if (is_row) over -= w->own[i] * w->z[i];
            w->rate[i] = (is_row ? w->own[i] : 0.0) + (same ? soft : 0.0);
        }
        if (part >= 0) over -= soft * (load - q->price[part]);
        memcpy(w->scratch, w->rate, (size_t)w->active * sizeof(double));
        solve_active(w, w->rate);
        double gain = length - dot(w->scratch, w->rate, w->active);
        if (!(over > 0.0) && z == 0.0) return 1;
        double step = gain > SINGULAR * length ? over / gain : NEVER, least = step;
        int64_t leaving = -1, yielding = -1;

        memset(w->loads, 0, (size_t)q->parts * sizeof(double));
        memset(w->rises, 0, (size_t)q->parts * sizeof(double));
        if (is_row && part >= 0) {
            w->loads[part] = z;
            w->rises[part] = 1.0;
        }
        for (int64_t i = 0; i < w->active; i++) {
            int64_t row = w->row[i];
            if (row < q->equations) continue;
            if (w->rate[i] > 0.0 && w->z[i] < least * w->rate[i]) {
                least = fmax(w->z[i], 0.0) / w->rate[i];
                leaving = i;
            }
            if (q->part[row] < 0) continue;
            w->loads[q->part[row]] += w->z[i];
            w->rises[q->part[row]] -= w->rate[i];
        }
        for (int64_t j = 0; j < q->parts; j++) {
            double room = q->price[j] - w->loads[j];
            if (w->yields[j] || !(w->rises[j] > 0.0) || room >= least * w->rises[j]) continue;
            least = fmax(room, 0.0) / w->rises[j];
            yielding = j;
        }
        if (least >= NEVER) return 0;

        for (int64_t i = 0; i < w->active; i++) w->z[i] -= least * w->rate[i];
        z += least;
        if (yielding >= 0) {
            if (!change_yield(q, w, yielding, 1)) return 0;
        } else if (leaving >= 0) {
            leave(w, leaving);
        } else {
            if (is_row ? w->active >= w->room - 1 || !join(q, w, which, z) : !change_yield(q, w, part, 0)) return 0;
            settle(q, w);
            return 1;
        }
    }
    return 0;
}

/* Begin with parts that yield where rows are violated at 0, by the row that is violated most; whether S is regular.

   Its multiplier is the price of the part, so that this is a minimum under the active rows as any other. */
static int begin(const StagedProgram *q, Work *w)
{
    for (int64_t j = 0; j < q->parts; j++) {
        w->excess[j] = q->tolerance;
        w->candidate[j] = -1;
    }
    for (int64_t i = q->equations; i < q->rows; i++) {
        int64_t part = q->part[i];
        if (part < 0 || !(-q->bound[i] > w->excess[part])) continue;
        w->excess[part] = -q->bound[i];
        w->candidate[part] = i;
    }
    for (int64_t j = 0; j < q->parts; j++) {
        if (w->candidate[j] < 0) continue;
        w->yields[j] = 1;
        prepare(q, w, w->candidate[j]);
        if (w->active >= w->room - 1 || !join(q, w, w->candidate[j], 0.0)) return 0;
    }
    settle(q, w);
    for (int64_t i = 0; i < w->active; i++)
        if (w->row[i] >= q->equations && !(w->z[i] > 0.0)) return 0;
    return 1;
}

/* Begin with the rows that are likely to be active; of those whose multipliers would be negative, the worst of each part
   leave until none is, so that this too is a minimum under the active rows. Whether that is reached. */
static int begin_likely(const StagedProgram *q, Work *w)
{
    int64_t first = w->active;
    for (int64_t i = q->equations; i < q->rows; i++) {
        if (!q->likely[i]) continue;
        prepare(q, w, i);
        if (w->active >= w->room - 1) return 0;
        if (q->part[i] >= 0 && q->likely[i] == 2) w->yields[q->part[i]] = 1;
        if (join(q, w, i, 0.0)) continue;
        w->active--;
        w->in[i] = 0;
    }
    for (int tries = 0; tries < BEGINNINGS && w->active > first; tries++) {
        int changed = 0;
        if (!factorise_active(q, w, first)) return 0;
        settle(q, w);
        memset(w->loads, 0, (size_t)q->parts * sizeof(double));
        memset(w->rises, 0, (size_t)q->parts * sizeof(double)); /* here the least multipliers */
        for (int64_t i = first; i < w->active; i++) {
            int64_t part = q->part[w->row[i]];
            if (part < 0) continue;
            w->loads[part] += w->z[i];
            w->rises[part] = fmin(w->rises[part], w->z[i]);
        }
        for (int64_t i = w->active - 1; i >= first; i--) {
            int64_t part = q->part[w->row[i]];
            if (w->z[i] > 0.0 || (part >= 0 && w->z[i] > w->rises[part])) continue;
            take_out(w, i);
            changed = 1;
        }
        for (int64_t j = 0; j < q->parts; j++) {
            int yields = w->loads[j] > (w->yields[j] ? 0.0 : q->price[j]);
            if (yields != w->yields[j] && w->loads[j] != 0.0) changed = 1;
            w->yields[j] = (uint8_t)yields;
        }
        if (!changed) return 1;
    }
    return 0;
}

static int solve(const StagedProgram *q, Work *w)
{
    if (!factorise(q, w)) return 0;
    for (int64_t k = 0; k < w->n; k++) w->free_y[k] = -q->gradient[k];
    forward(w, q->width, w->free_y, 0);
    for (int64_t i = 0; i < q->equations; i++) {
        prepare(q, w, i);
        /* An equation that depends on others holds as they do. */
        if (w->active >= w->room - 1) return 0;
        if (join(q, w, i, 0.0)) continue;
        w->active--;
    }
    int64_t first = w->active;
    if (!begin_likely(q, w)) {
        for (int64_t i = first; i < w->active; i++) w->in[w->row[i]] = 0;
        memset(w->yields, 0, (size_t)q->parts);
        w->active = first;
        if (!begin(q, w)) return 0;
    }
    int64_t left = q->most;
    double most;
    while ((most = find_violated(q, w)) > 0.0)
        for (int64_t i = 0; i < 2 * q->parts + q->stages; i++)
            if (w->candidate[i] >= 0 && w->excess[i] >= WORTH * most && !enforce(q, w, w->candidate[i], &left)) return 0;
    for (int64_t i = 0; i < w->active; i++) q->multipliers[w->row[i]] = w->z[i];
    return 1;
}

PUBLIC void staged_program(StagedProgram *q)
{
    int64_t n = q->stages * q->width, band = 3 * q->width - 1, room = q->equations + 2;
    room += n + q->parts < MOST_ACTIVE ? n + q->parts : MOST_ACTIVE;
    Work w = {.n = n, .band = band, .room = room};
    double *numbers = malloc(sizeof(double) * (size_t)(n * (band + 1) + n + room + (room + 1) * n + 2 * room * room +
                                                       5 * (room + 1) + 4 * q->parts + q->stages));
    w.row = malloc(sizeof(int64_t) * (size_t)(2 * (room + 1) + 2 * q->parts + q->stages));
    w.in = calloc((size_t)(q->rows + q->parts + 1), 1);
    q->solved = 0;
    memset(q->multipliers, 0, (size_t)q->rows * sizeof(double));
    if (numbers && w.row && w.in) {
        w.yields = w.in + q->rows;
        w.place = w.row + room + 1;
        w.candidate = w.place + room + 1;
        for (int64_t i = 0; i <= room; i++) w.place[i] = i;
        w.factor = numbers;
        w.free_y = w.factor + n * (band + 1);
        w.scratch = w.free_y + n;
        w.vectors = w.scratch + room;
        w.products = w.vectors + (room + 1) * n;
        w.chol = w.products + room * room;
        w.target = w.chol + room * room;
        w.z = w.target + room + 1;
        w.own = w.z + room + 1;
        w.rate = w.own + room + 1;
        w.turned = w.rate + room + 1;
        w.loads = w.turned + room + 1;
        w.rises = w.loads + q->parts;
        w.excess = w.rises + q->parts;
        q->solved = solve(q, &w);
    }
    free(numbers);
    free(w.row);
    free(w.in);
}
