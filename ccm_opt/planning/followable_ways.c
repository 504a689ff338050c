/* The search for ways that an arm can follow behind its tip (hybrid A* in space): followable_ways.py says of what. */

#include "native.h"

enum { BINS = 7 }; /* what states are told apart by: three bins of the place, face, side, two bins on the face */

/* A place on a way with the frame (t, n1, n2) there as columns, row by row, and how the way came there. */
typedef struct {
    double place[3], frame[9], cost, length;
    int64_t before, arc;
} State;

typedef struct {
    int64_t nx, ny, nz;                     /* cells of the grid */
    int64_t choices, samples;               /* arcs that lead on, and places on each */
    int64_t directed;                       /* whether the direction at the goal counts */
    int64_t most_states, direction_bins, table; /* the last: slots for bins, a power of two */
    double cell, step, most;                /* size of a cell, length of an arc, of the longest way */
    double place_bin, landing, longest, radius, spacing;
    double low[3], goal[3], direction[3];
    const float *price;                     /* of a way through a cell; not positive where it is blocked */
    const double *left;                     /* cost of what is left from each cell */
    const double *arcs, *turns, *dear;      /* (choices, samples, 3), (choices, 3, 3), (choices,) */
    State *states;                          /* the first one is given; room for most_states × choices more */
    int64_t *heap;                          /* working memory, (most_states × choices + 1,) */
    double *key;                            /* likewise */
    int32_t *bins;                          /* working memory, (table, 7) */
    uint8_t *taken;                         /* likewise, zeros, (table,) */
    int64_t found;                          /* out: the state from which two arcs lead to the goal, −1 where there is none */
} FollowQuery;

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Cell of a place; the nearest one where it lies outside. */
static int64_t cell_of(const FollowQuery *q, const double *place)
{
    const int64_t counts[3] = {q->nx, q->ny, q->nz};
    int64_t cell = 0;
    for (int64_t d = 0; d < 3; d++) {
        cell = cell * counts[d] + whole_within(rint((place[d] - q->low[d]) / q->cell), 0, counts[d] - 1);
    }
    return cell;
}

static int32_t bin_of(double x) { return (int32_t)whole_within(floor(x), INT32_MIN, INT32_MAX); }

static void bins_of(const FollowQuery *q, const State *state, int32_t *bins)
{
    const double t[3] = {state->frame[0], state->frame[3], state->frame[6]};
    int64_t face = 0, next = 5;
    for (int64_t d = 0; d < 3; d++) {
        bins[d] = bin_of(state->place[d] / q->place_bin);
        if (fabs(t[d]) > fabs(t[face])) face = d;
    }
    bins[3] = (int32_t)face;
    bins[4] = t[face] > 0.0;
    for (int64_t d = 0; d < 3; d++)
        if (d != face) bins[next++] = bin_of(t[d] / t[face] * (double)q->direction_bins);
}

/* The slot of some bins in the table, or the empty one where they belong. */
static int64_t slot_of(const FollowQuery *q, const int32_t *bins)
{
    uint64_t hash = 1469598103934665603u;
    for (int64_t k = 0; k < BINS; k++) hash = (hash ^ (uint32_t)bins[k]) * 1099511628211u;
    int64_t slot = (int64_t)((hash ^ hash >> 29) & (uint64_t)(q->table - 1));
    while (q->taken[slot] && memcmp(q->bins + BINS * slot, bins, BINS * sizeof *bins)) slot = (slot + 1) & (q->table - 1);
    return slot;
}

/* The earlier one of two states with the same estimate comes first: numbers of states grow as they are found. */
static int earlier(const FollowQuery *q, double key, int64_t state, int64_t at)
{
    return key < q->key[at] || (key == q->key[at] && state < q->heap[at]);
}

static void put_at(FollowQuery *q, int64_t at, int64_t state, double key)
{
    q->heap[at] = state;
    q->key[at] = key;
}

static void push(FollowQuery *q, int64_t at, int64_t state, double key)
{
    for (; at && earlier(q, key, state, (at - 1) / 2); at = (at - 1) / 2)
        put_at(q, at, q->heap[(at - 1) / 2], q->key[(at - 1) / 2]);
    put_at(q, at, state, key);
}

/* The first state; the heap has this many left. */
static int64_t pop(FollowQuery *q, int64_t left)
{
    int64_t first = q->heap[0], state = q->heap[left], at = 0, child;
    double key = q->key[left];
    while ((child = 2 * at + 1) < left) {
        if (child + 1 < left && earlier(q, q->key[child + 1], q->heap[child + 1], child)) child++;
        if (earlier(q, key, state, child)) break;
        put_at(q, at, q->heap[child], q->key[child]);
        at = child;
    }
    put_at(q, at, state, key);
    return first;
}

/* An arc along a direction over a chord: half its turn, its length and the unit vector to which it bends. */
typedef struct {
    double half, length, side[3];
} Arc;

static Arc arc_over(const double *direction, const double *chord)
{
    Arc arc;
    double along = dot(direction, chord);
    for (int64_t d = 0; d < 3; d++) arc.side[d] = chord[d] - along * direction[d];
    double aside = sqrt(dot(arc.side, arc.side));
    for (int64_t d = 0; d < 3; d++) arc.side[d] = aside > 0.0 ? arc.side[d] / aside : 0.0;
    arc.half = atan2(aside, along);
    arc.length = sqrt(dot(chord, chord)) * (arc.half > 0.0 ? arc.half / sin(arc.half) : 1.0);
    return arc;
}

/* Whether there is room along an arc from a place on; the place and the direction become those at its end. */
static int free_along(const FollowQuery *q, double *place, double *direction, const Arc *arc)
{
    int64_t count = whole_within(ceil(arc->length / q->spacing), 2, INT32_MAX);
    double start[3], t[3], turn = 2.0 * arc->half;
    memcpy(start, place, sizeof start);
    memcpy(t, direction, sizeof t);
    for (int64_t k = 1; k <= count; k++) {
        double s = (double)k / (double)count, angle = turn * s;
        /* sin(x) / x and (1 − cos(x)) / x, also where the arc is straight */
        double whole = angle > 0.0 ? sin(angle) / angle : 1.0;
        double part = angle > 0.0 ? 2.0 * sin(0.5 * angle) / angle * sin(0.5 * angle) : 0.0;
        for (int64_t d = 0; d < 3; d++)
            place[d] = start[d] + arc->length * s * (whole * t[d] + part * arc->side[d]);
        if (!(q->price[cell_of(q, place)] > 0.0f)) return 0;
    }
    for (int64_t d = 0; d < 3; d++) direction[d] = cos(turn) * t[d] + sin(turn) * arc->side[d];
    return 1;
}

/* Whether two arcs lead from a state to the goal with room beside them, neither bent too much nor too long a way. */
static int lands(const FollowQuery *q, const State *state)
{
    double chord[3], start[3], direction[3], first[3], second[3], place[3];
    for (int64_t d = 0; d < 3; d++) {
        chord[d] = q->goal[d] - state->place[d];
        start[d] = state->frame[3 * d];
        place[d] = state->place[d];
    }
    double square = dot(chord, chord), away = sqrt(square);
    if (away > q->landing) return 0;
    if (away < 1e-9) return 1;
    /* One arc ends so: the direction is mirrored at the chord. */
    for (int64_t d = 0; d < 3; d++)
        direction[d] = q->directed ? q->direction[d] : 2.0 * dot(chord, start) / square * chord[d] - start[d];
    /* As in biarc.py: tangents of equal length at both ends. */
    double along = dot(chord, start) + dot(chord, direction);
    double root = sqrt(along * along + 2.0 * square * (1.0 - dot(start, direction)));
    if (!(along + root > 1e-9 * away)) return 0;
    double tangent = square / (along + root);
    for (int64_t d = 0; d < 3; d++) {
        double middle = 0.5 * (state->place[d] + q->goal[d] + tangent * (start[d] - direction[d]));
        first[d] = middle - state->place[d];
        second[d] = q->goal[d] - middle;
    }
    Arc arcs[2] = {arc_over(start, first)};
    double turn = 2.0 * arcs[0].half;
    for (int64_t d = 0; d < 3; d++) direction[d] = cos(turn) * start[d] + sin(turn) * arcs[0].side[d];
    arcs[1] = arc_over(direction, second);
    for (int64_t k = 0; k < 2; k++)
        if (!(2.0 * arcs[k].half * q->radius <= 1.001 * arcs[k].length)) return 0;
    if (!(arcs[0].length + arcs[1].length <= q->longest * away)) return 0;
    return free_along(q, place, start, &arcs[0]) && free_along(q, place, start, &arcs[1]);
}

/* The state one arc on from another, as the next in memory; the estimate of a whole way through it, −1 for no room. */
static double following(const FollowQuery *q, int64_t before, int64_t choice, State *next)
{
    const State *state = q->states + before;
    const double *arc = q->arcs + 3 * q->samples * choice, *turn = q->turns + 9 * choice;
    double prices = 0.0;
    int64_t cell = 0;
    for (int64_t k = 0; k < q->samples; k++, arc += 3) {
        for (int64_t d = 0; d < 3; d++) {
            const double *f = state->frame + 3 * d;
            next->place[d] = state->place[d] + (f[0] * arc[0] + f[1] * arc[1] + f[2] * arc[2]);
        }
        cell = cell_of(q, next->place);
        if (!(q->price[cell] > 0.0f)) return -1.0;
        prices += q->price[cell];
    }
    if (!isfinite(q->left[cell])) return -1.0;
    for (int64_t i = 0; i < 3; i++)
        for (int64_t j = 0; j < 3; j++)
            next->frame[3 * i + j] =
                state->frame[3 * i] * turn[j] + state->frame[3 * i + 1] * turn[3 + j] + state->frame[3 * i + 2] * turn[6 + j];
    next->cost = state->cost + q->step * q->dear[choice] * (prices / (double)q->samples);
    next->length = state->length + q->step;
    next->before = before;
    next->arc = choice;
    return next->cost + q->left[cell];
}

/* Whether a way through a state can still be short enough. */
static int short_enough(const FollowQuery *q, const State *state)
{
    double chord[3];
    for (int64_t d = 0; d < 3; d++) chord[d] = q->goal[d] - state->place[d];
    return state->length + q->step + sqrt(dot(chord, chord)) <= q->most + q->step;
}

PUBLIC void followable_way(FollowQuery *q)
{
    int64_t waiting = 1, states = 1;
    q->found = -1;
    put_at(q, 0, 0, 0.0);
    for (int64_t looked = 0; looked < q->most_states && waiting; looked++) {
        int32_t bins[BINS];
        int64_t state = pop(q, --waiting);
        bins_of(q, q->states + state, bins);
        int64_t slot = slot_of(q, bins);
        if (q->taken[slot]) continue;
        q->taken[slot] = 1;
        memcpy(q->bins + BINS * slot, bins, sizeof bins);
        if (lands(q, q->states + state)) {
            q->found = state;
            return;
        }
        if (!short_enough(q, q->states + state)) continue;
        for (int64_t choice = 0; choice < q->choices; choice++) {
            State *next = q->states + states;
            double estimate = following(q, state, choice, next);
            if (estimate < 0.0) continue;
            bins_of(q, next, bins);
            if (!q->taken[slot_of(q, bins)]) push(q, waiting++, states++, estimate);
        }
    }
}

typedef struct {
    int64_t count, samples;   /* positions of a joint; samples of the track */
    int64_t ahead, window;    /* samples of a window among which the nearest one is sought, and all of them */
    double link;              /* length of the link */
    const double *track;      /* (samples, 3) */
    const int64_t *first;     /* (count,) sample at which the window of each position begins, maybe before the track */
    const double *joints;     /* (count, 3) */
    int64_t *nearest;         /* (count,) sample that is nearest to each position */
    double *chords;           /* (count, 3) direction to the first sample beyond it that is a link away */
} LinkChords;

static int64_t sample_of(const LinkChords *q, int64_t place)
{
    return place < 0 ? 0 : place < q->samples ? place : q->samples - 1;
}

static double distance(const double *a, const double *b)
{
    double off[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(dot(off, off));
}

PUBLIC void link_chords(LinkChords *q)
{
    for (int64_t t = 0; t < q->count; t++) {
        const double *joint = q->joints + 3 * t;
        double least = INFINITY, away = 0.0, before = 0.0, aim[3];
        int64_t nearest = 0, beyond;
        for (int64_t k = 0; k < q->ahead; k++) {
            double here = distance(q->track + 3 * sample_of(q, q->first[t] + k), joint);
            if (here < least) {
                least = away = here;
                nearest = k;
            }
        }
        for (beyond = nearest + 1; beyond < q->window; beyond++) {
            before = away;
            away = distance(q->track + 3 * sample_of(q, q->first[t] + beyond), joint);
            if (away >= q->link) break;
        }
        /* Where the track ends too soon, aim at its end. */
        if (beyond == q->window) beyond--;
        double grown = away - before, share = (q->link - before) / (grown > 0.0 ? grown : 1.0);
        share = share > 0.0 ? share < 1.0 ? share : 1.0 : 0.0;
        const double *from = q->track + 3 * sample_of(q, q->first[t] + beyond - 1);
        const double *to = q->track + 3 * sample_of(q, q->first[t] + beyond);
        for (int k = 0; k < 3; k++) aim[k] = (1.0 - share) * from[k] + share * to[k] - joint[k];
        double length = fmax(sqrt(dot(aim, aim)), 1e-12);
        for (int k = 0; k < 3; k++) q->chords[3 * t + k] = aim[k] / length;
        q->nearest[t] = sample_of(q, q->first[t] + nearest);
    }
}
