/* The proof that an arm touches nothing while its coordinates change evenly: surface_certificate.py says why it
   holds. */

#include "link_places.h"
#include "surface_nodes.h"

#define FINE 0.0625 /* share of the slack that is left where distances are taken for halvings */

/* How much farther than is needed the surfaces are looked for: so many motions of the link, or such a share of the
   longest link if that is less. What is that far off need not be looked for again in as many intervals like this one. */
#define AHEAD 8.0
#define AHEAD_SHARE 0.2

/* Least distance of a segment from the surfaces, (2, 3), cut off at a reach, and told too small by a slack at most. */
double segment_gap(const Surfaces *surfaces, const double *segment, double reach, double slack);

typedef struct {
    int64_t links, first_link;      /* links before the first are not looked at */
    const int32_t *next_pair;       /* as in arm_motion.c */
    int64_t depth;                  /* how often an interval may be halved */
    const double *arcs; /* as in link_places.h, or missing */
    const double *turns; /* constant rotations of the links, as in link_places.h; may be missing */
    const double *lengths, *mount;  /* of the links, and the share of each inside the mount, (links,) */
    const double *radii;            /* (links,) */
    const double *wall;             /* distances that the links' axes keep from surfaces, (links,) */
    double longest, thickest, pair; /* length and radius; gap that links keep from each other */
    double slack;         /* share of a link's motion by which distances may be told too small at first */
    Carrier carrier;
    int64_t intervals;
    const double *keyframes; /* (intervals + 1, c) */
    uint8_t *safe;           /* (intervals,) whether each is proved safe */
    const Surfaces *surfaces; /* may be missing */
    double *end, *told; /* for the next call: where this one ends, and (5, links) distances there */
} ProofQuery;

/* Distances of the links at one end of an interval, told too small by a slack at most and taken for halvings, and the
   reaches that they were cut off at, which are zero where a distance is not known; and what no distance is less than. */
typedef struct {
    double *told, *told_reach, *sure, *sure_reach, *least;
} EndGaps;

typedef struct {
    double *bends, *points, *rotations;
} Place;

/* An interval with what bounds it: the way of a point is at most its chord and half its bow. */
typedef struct {
    Place middle;
    double *chords, *bows, *speeds; /* (links + 1, 3), (links + 1,) and (links + 1,) */
} Interval;

/* Links that are still to be proved, with their distances at both ends, each of length count. */
typedef struct {
    int64_t count, *link;
    double *first, *last;
} Links;

/* The same of pairs of links. */
typedef struct {
    int64_t count, *one, *other;
    double *first, *last;
} Pairs;

static int64_t coordinates(const ProofQuery *q) { return 2 * q->links + q->carrier.count; }

static int64_t place_size(const ProofQuery *q) { return coordinates(q) + 3 * (q->links + 1) + 9 * q->links; }

static int64_t interval_size(const ProofQuery *q) { return place_size(q) + 5 * (q->links + 1) + q->links + coordinates(q); }

static Place place_in(const ProofQuery *q, double *memory)
{
    Place place = {memory, memory + coordinates(q), memory + coordinates(q) + 3 * (q->links + 1)};
    return place;
}

static void put(const ProofQuery *q, const Place *place)
{
    place_links(q->links, q->lengths, q->turns, q->arcs, &q->carrier, place->bends, place->points, place->rotations);
}

static Interval interval_between(const ProofQuery *q, const Place *first, const Place *last, double *memory)
{
    int64_t n = q->links;
    Interval interval = {place_in(q, memory), memory + place_size(q), NULL, NULL};
    interval.bows = interval.chords + 3 * (n + 1);
    interval.speeds = interval.bows + n + 1;
    double *turns = interval.speeds + n + 1, *rates = turns + coordinates(q);
    for (int64_t k = 0; k < coordinates(q); k++)
        interval.middle.bends[k] = 0.5 * (first->bends[k] + last->bends[k]);
    put(q, &interval.middle);
    for (int64_t k = 0; k < coordinates(q); k++) turns[k] = last->bends[k] - first->bends[k];
    bound_motion(n, q->lengths, q->arcs, &q->carrier, interval.middle.bends, interval.middle.rotations, turns, rates,
                 interval.bows);
    for (int64_t j = 0; j <= n; j++) {
        double *chord = interval.chords + 3 * j;
        for (int d = 0; d < 3; d++) chord[d] = last->points[3 * j + d] - first->points[3 * j + d];
        interval.speeds[j] = sqrt(dot(chord, chord)) + 0.5 * interval.bows[j];
    }
    return interval;
}

/* How far a link moves at most. */
static double most_of(const Interval *interval, int64_t link)
{
    return fmax(interval->speeds[link], interval->speeds[link + 1]);
}

/* Distance of the part of a link that is beyond the mount. */
static double gap_of(const ProofQuery *q, const Place *place, int64_t link, double reach, double slack)
{
    double segment[6];
    const double *points = place->points + 3 * link;
    for (int k = 0; k < 6; k++) segment[k] = points[k];
    double share = q->mount[link];
    if (share > 0.0 && share < 1.0)
        for (int d = 0; d < 3; d++) segment[d] += share * (segment[3 + d] - segment[d]);
    return segment_gap(q->surfaces, segment, reach, slack);
}

/* What is known of links and surfaces: exact distances may still prove what is not known. */
typedef enum { TOUCHING, CLEAR, UNKNOWN } Outcome;

/* As the distance of a link, or told too small by a slack at most; below the wall's only where it is in truth. */
static double sure_gap_of(const ProofQuery *q, const Place *place, int64_t link, double reach, double slack)
{
    double gap = gap_of(q, place, link, reach, slack);
    if (!(gap < q->wall[link]) || gap + slack < q->wall[link] || slack == 0.0) return gap;
    /* Whether anything is that near is found sooner than how near it is. */
    return gap_of(q, place, link, q->wall[link], 0.0);
}

/* Whether some links keep off the surfaces; distances at the ends are known. Distances are told too small by a share of
   the links' motions at most. Written so that what is no number fails. */
static Outcome walls_clear(const ProofQuery *q, const Place *first, const Place *last, const Interval *interval,
                           const Links *links, int64_t depth, double slack)
{
    int64_t count = links->count;
    int64_t *numbers = malloc((size_t)count * sizeof(int64_t));
    double *memory = malloc((size_t)(3 * count + interval_size(q)) * sizeof(double));
    Outcome outcome = numbers && memory ? CLEAR : TOUCHING;
    Links halves[2] = {{0, numbers, memory, memory + count}, {0, numbers, memory + count, memory + 2 * count}};
    for (int64_t k = 0; outcome == CLEAR && k < count; k++) {
        int64_t link = links->link[k], left = halves[0].count;
        double most = most_of(interval, link), middle = 0.0;
        if (links->first[k] + links->last[k] - most >= 2.0 * q->wall[link]) continue;
        if (depth == 0) {
            outcome = UNKNOWN;
        } else {
            /* A half of the interval moves the link half as far, or hardly more. */
            middle = sure_gap_of(q, &interval->middle, link, q->wall[link] + 0.75 * most, slack * most);
            if (!(middle >= q->wall[link])) outcome = TOUCHING;
        }
        numbers[left] = link;
        halves[0].first[left] = links->first[k];
        halves[0].last[left] = middle;
        halves[1].last[left] = links->last[k];
        halves[0].count = halves[1].count = left + 1;
    }
    for (int half = 0; half < 2 && outcome == CLEAR && halves[half].count; half++) {
        const Place *from = half ? &interval->middle : first, *to = half ? last : &interval->middle;
        Interval part = interval_between(q, from, to, memory + 3 * count);
        outcome = walls_clear(q, from, to, &part, halves + half, depth - 1, slack);
    }
    free(numbers);
    free(memory);
    return outcome;
}

static EndGaps end_gaps(double *memory, int64_t links)
{
    EndGaps gaps = {memory, memory + links, memory + 2 * links, memory + 3 * links, memory + 4 * links};
    return gaps;
}

/* Forget all distances at an end. */
static void forget(EndGaps *gaps, int64_t links)
{
    memset(gaps->told, 0, (size_t)(4 * links) * sizeof(double));
    for (int64_t link = 0; link < links; link++) gaps->least[link] = -INFINITY;
}

/* Distance of a link at an end, looked up where it was measured as far. */
static double known_gap(const ProofQuery *q, const Place *place, double *gap, double *measured, int64_t link,
                        double reach, double slack, int sure)
{
    if (!(gap[link] < measured[link] || measured[link] >= reach)) {
        gap[link] = sure ? sure_gap_of(q, place, link, reach, slack) : gap_of(q, place, link, reach, slack);
        measured[link] = reach;
    }
    return gap[link] > reach ? reach : gap[link];
}

/* Whether the links that are left keep off the surfaces, by exact distances. */
static Outcome exactly_clear(const ProofQuery *q, const Place *first, const Place *last, const Interval *interval,
                             const Links *left)
{
    for (int64_t k = 0; k < left->count; k++) {
        double reach = q->wall[left->link[k]] + most_of(interval, left->link[k]);
        left->first[k] = gap_of(q, first, left->link[k], reach, 0.0);
        left->last[k] = gap_of(q, last, left->link[k], reach, 0.0);
    }
    return walls_clear(q, first, last, interval, left, q->depth, 0.0);
}

/* Whether all links keep off the surfaces. Most intervals begin where the one before has ended, so that half of the
   distances are known, and of links that are far off, that they cannot have come near. */
static int all_walls_clear(const ProofQuery *q, const Place *first, const Place *last, const Interval *interval)
{
    int64_t most_links = q->links - q->first_link;
    if (!q->surfaces || most_links <= 0) return 1;
    int64_t *numbers = malloc((size_t)most_links * sizeof(int64_t));
    double *memory = malloc((size_t)(2 * most_links + 5 * q->links) * sizeof(double));
    Links left = {0, numbers, memory, memory + most_links};
    Outcome outcome = numbers && memory ? CLEAR : TOUCHING;
    size_t end_size = (size_t)coordinates(q) * sizeof(double), gaps_size = (size_t)(5 * q->links) * sizeof(double);
    EndGaps start = end_gaps(memory + 2 * most_links, q->links), end = end_gaps(q->told, q->links);
    if (outcome == CLEAR) {
        if (memcmp(q->end, first->bends, end_size) == 0)
            memcpy(start.told, q->told, gaps_size);
        else
            forget(&start, q->links);
        memcpy(q->end, last->bends, end_size);
        forget(&end, q->links);
    }
    for (int64_t link = q->first_link; outcome == CLEAR && link < q->links; link++) {
        if (q->radii[link] < 0.0) continue; /* a link without a body */
        double most = most_of(interval, link), wall = q->wall[link], reach = wall + most, slack = q->slack * most;
        /* So far off half-way that it comes to no wall: from there it moves half as far at most. */
        double far = wall + 0.5 * most, ahead = fmin(AHEAD * most, AHEAD_SHARE * q->longest);
        double half = 0.5 * (1.0 + 1e-9) * most, middle = start.least[link] - half;
        if (!(middle >= far)) middle = gap_of(q, &interval->middle, link, far + ahead, slack);
        end.least[link] = middle - half;
        if (middle >= far) continue;
        double at_first = known_gap(q, first, start.told, start.told_reach, link, reach, slack, 0);
        double at_last = known_gap(q, last, end.told, end.told_reach, link, reach, slack, 0);
        if (at_first >= wall && at_last >= wall && at_first + at_last - most >= 2.0 * wall) continue;
        at_first = known_gap(q, first, start.sure, start.sure_reach, link, reach, FINE * slack, 1);
        at_last = known_gap(q, last, end.sure, end.sure_reach, link, reach, FINE * slack, 1);
        if (!(at_first >= wall && at_last >= wall)) outcome = TOUCHING;
        left.link[left.count] = link;
        left.first[left.count] = at_first;
        left.last[left.count] = at_last;
        left.count++;
    }
    if (outcome == CLEAR) outcome = walls_clear(q, first, last, interval, &left, q->depth, FINE * q->slack);
    if (outcome == UNKNOWN) outcome = exactly_clear(q, first, last, interval, &left);
    free(numbers);
    free(memory);
    return outcome == CLEAR;
}

/* How far a pair of links comes nearer at most: what both have in common does not count. */
static double approach(const Interval *interval, int64_t one, int64_t other)
{
    double most = 0.0;
    for (int64_t i = one; i <= one + 1; i++)
        for (int64_t j = other; j <= other + 1; j++) {
            double chord[3];
            for (int d = 0; d < 3; d++) chord[d] = interval->chords[3 * j + d] - interval->chords[3 * i + d];
            double way = sqrt(dot(chord, chord)) + 0.5 * (interval->bows[j] - interval->bows[i]);
            most = way > most ? way : most;
        }
    return most;
}

/* Distance that the axes of two links keep from each other. */
static double pair_kept(const ProofQuery *q, int64_t one, int64_t other)
{
    return q->radii[one] + q->radii[other] + q->pair;
}

static int pairs_clear(const ProofQuery *q, const Place *first, const Place *last, const Interval *interval,
                       const Pairs *pairs, int64_t depth)
{
    int64_t count = pairs->count;
    int64_t *numbers = malloc((size_t)(2 * count) * sizeof(int64_t));
    double *memory = malloc((size_t)(3 * count + interval_size(q)) * sizeof(double));
    int clear = numbers && memory;
    Pairs halves[2] = {{0, numbers, numbers + count, memory, memory + count},
                       {0, numbers, numbers + count, memory + count, memory + 2 * count}};
    for (int64_t k = 0; clear && k < count; k++) {
        int64_t one = pairs->one[k], other = pairs->other[k], left = halves[0].count;
        double kept = pair_kept(q, one, other);
        if (pairs->first[k] + pairs->last[k] - approach(interval, one, other) >= 2.0 * kept) continue;
        double s, t, middle = depth ? links_apart(interval->middle.points, one, other, &s, &t) : -INFINITY;
        clear = middle >= kept;
        numbers[left] = one;
        numbers[count + left] = other;
        halves[0].first[left] = pairs->first[k];
        halves[0].last[left] = middle;
        halves[1].last[left] = pairs->last[k];
        halves[0].count = halves[1].count = left + 1;
    }
    for (int half = 0; half < 2 && clear && halves[half].count; half++) {
        const Place *from = half ? &interval->middle : first, *to = half ? last : &interval->middle;
        Interval part = interval_between(q, from, to, memory + 3 * count);
        clear = pairs_clear(q, from, to, &part, halves + half, depth - 1);
    }
    free(numbers);
    free(memory);
    return clear;
}

/* Numbers of the pairs that may come too near, and their distances at both ends; the arrays may be missing. */
static int64_t near_pairs(const ProofQuery *q, const Place *first, const Place *last, double reach, Pairs *pairs)
{
    int64_t count = 0;
    for (int64_t i = 0; i < q->links; i++) {
        int64_t j = next_in_reach(first->points, q->links, q->next_pair, i, 0, reach, q->longest);
        for (; j < q->links; j = next_in_reach(first->points, q->links, q->next_pair, i, j + 1, reach, q->longest)) {
            double s, t, apart = links_apart(first->points, i, j, &s, &t);
            if (apart >= reach) continue;
            if (pairs) {
                pairs->one[count] = i;
                pairs->other[count] = j;
                pairs->first[count] = apart;
                pairs->last[count] = links_apart(last->points, i, j, &s, &t);
            }
            count++;
        }
    }
    return count;
}

static int all_pairs_clear(const ProofQuery *q, const Place *first, const Place *last, const Interval *interval)
{
    double fastest = 0.0;
    for (int64_t j = 0; j <= q->links; j++) fastest = fmax(fastest, interval->speeds[j]);
    double reach = 2.0 * q->thickest + q->pair + 2.0 * fastest;
    int64_t count = near_pairs(q, first, last, reach, NULL);
    if (count == 0) return 1;
    int64_t *numbers = malloc((size_t)(2 * count) * sizeof(int64_t));
    double *memory = malloc((size_t)(2 * count) * sizeof(double));
    Pairs left = {count, numbers, numbers + count, memory, memory + count};
    int clear = numbers && memory;
    if (clear) near_pairs(q, first, last, reach, &left);
    for (int64_t k = 0; clear && k < count; k++) {
        double kept = pair_kept(q, left.one[k], left.other[k]);
        clear = left.first[k] >= kept && left.last[k] >= kept;
    }
    clear = clear && pairs_clear(q, first, last, interval, &left, q->depth);
    free(numbers);
    free(memory);
    return clear;
}

PUBLIC void prove_intervals(ProofQuery *q)
{
    int64_t size = coordinates(q);
    double *memory = malloc((size_t)(2 * place_size(q) + interval_size(q)) * sizeof(double));
    memset(q->safe, 0, (size_t)q->intervals);
    if (!memory || q->intervals == 0) {
        free(memory);
        return;
    }
    Place first = place_in(q, memory), last = place_in(q, memory + place_size(q));
    memcpy(last.bends, q->keyframes, (size_t)size * sizeof(double));
    put(q, &last);
    for (int64_t k = 0; k < q->intervals; k++) {
        Place before = first;
        first = last;
        last = before;
        memcpy(last.bends, q->keyframes + size * (k + 1), (size_t)size * sizeof(double));
        put(q, &last);
        Interval interval = interval_between(q, &first, &last, memory + 2 * place_size(q));
        /* Where coordinates are no numbers, no link is anywhere. */
        q->safe[k] = isfinite(interval.speeds[q->links]) && all_walls_clear(q, &first, &last, &interval)
                     && all_pairs_clear(q, &first, &last, &interval);
    }
    free(memory);
}
