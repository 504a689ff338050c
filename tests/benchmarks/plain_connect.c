/* A plain RRT-Connect (Kuffner and LaValle, 2000) in the bends of a planar arm, its motions swept: what a sampling
 * planner does with a scene. It shares nothing with the package. See plain_connect.py. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define MOST_LINKS 64

typedef struct {
    long links, edges, first_pair, mount_link;
    double length, radius, gap, heading, mount_share;
    const double *base, *limits, *walls, *rounding; /* walls: 4 numbers an edge */
} Scene;

typedef struct {
    double *bends;
    long *parents;
    long count, capacity;
} Tree;

static double now(void) { return (double)clock() / CLOCKS_PER_SEC; }

/* ---------------------------------------------------------------- distances */
static double point_segment(const double *p, const double *a, const double *b) {
    double dx = b[0] - a[0], dy = b[1] - a[1], x = p[0] - a[0], y = p[1] - a[1];
    double square = dx * dx + dy * dy, t = square > 0.0 ? (x * dx + y * dy) / square : 0.0;
    t = t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
    x -= t * dx;
    y -= t * dy;
    return sqrt(x * x + y * y);
}

static double side(const double *p, const double *q, const double *r) {
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

static double segments(const double *p, const double *q, const double *r, const double *s) {
    if (side(p, q, r) * side(p, q, s) < 0.0 && side(r, s, p) * side(r, s, q) < 0.0) return 0.0;
    return fmin(fmin(point_segment(p, r, s), point_segment(q, r, s)), fmin(point_segment(r, p, q), point_segment(s, p, q)));
}

/* ---------------------------------------------------------------- swept motions */
/* 1 when nothing comes nearer than it may while no joint k moves farther than moved[k] from the pose and no two links
 * i < j come nearer by more than the turns between them allow; 0 when the pose touches; -1 when neither is sure. */
static int judged(const Scene *s, const double *headings, const double *turns, double half) {
    double at[2 * (MOST_LINKS + 1)], moved = 0.0;
    int sure = 1;
    at[0] = s->base[0];
    at[1] = s->base[1];
    for (long i = 0; i < s->links; ++i) {
        at[2 * i + 2] = at[2 * i] + s->length * cos(headings[i]);
        at[2 * i + 3] = at[2 * i + 1] + s->length * sin(headings[i]);
    }
    for (long i = 0; i < s->links; ++i) {
        moved += s->length * fabs(turns[i]) * half;
        if (i < s->mount_link) continue;
        double p[2] = {at[2 * i], at[2 * i + 1]};
        const double *q = at + 2 * i + 2;
        if (i == s->mount_link) {
            p[0] += s->mount_share * (q[0] - p[0]);
            p[1] += s->mount_share * (q[1] - p[1]);
        }
        double mx = 0.5 * (p[0] + q[0]), my = 0.5 * (p[1] + q[1]);
        for (long k = 0; k < s->edges; ++k) {
            const double *w = s->walls + 4 * k;
            double keep = s->gap + s->rounding[k];
            double ex = w[2] - w[0], ey = w[3] - w[1], x = 0.5 * (w[0] + w[2]) - mx, y = 0.5 * (w[1] + w[3]) - my;
            double far = keep + moved + 0.5 * s->length + 0.5 * sqrt(ex * ex + ey * ey);
            if (x * x + y * y > far * far) continue;
            double d = segments(p, q, w, w + 2);
            if (d <= keep) return 0;
            if (d <= keep + moved) sure = 0;
        }
        for (long j = i + s->first_pair; s->first_pair > 0 && j < s->links; ++j) {
            double relative = 0.0, keep = 2.0 * s->radius;
            for (long k = i + 1; k <= j; ++k) relative += s->length * fabs(turns[k] - turns[i]) * half;
            double d = segments(at + 2 * i, at + 2 * i + 2, at + 2 * j, at + 2 * j + 2);
            if (d <= keep) return 0;
            if (d <= keep + relative) sure = 0;
        }
    }
    return sure ? 1 : -1;
}

static int swept_free(const Scene *s, const double *start, const double *turns, double from, double to, int depth) {
    double headings[MOST_LINKS], middle = 0.5 * (from + to);
    for (long i = 0; i < s->links; ++i) headings[i] = start[i] + middle * turns[i];
    int judgement = judged(s, headings, turns, 0.5 * (to - from));
    if (judgement >= 0) return judgement;
    if (depth == 0) return 0;
    return swept_free(s, start, turns, from, middle, depth - 1) && swept_free(s, start, turns, middle, to, depth - 1);
}

static int motion_free(const Scene *s, const double *a, const double *b) {
    double start[MOST_LINKS], turns[MOST_LINKS], first = s->heading, last = s->heading;
    for (long i = 0; i < s->links; ++i) {
        first += a[i];
        last += b[i];
        start[i] = first;
        turns[i] = last - first;
    }
    return swept_free(s, start, turns, 0.0, 1.0, 16);
}

/* ---------------------------------------------------------------- trees */
static long added(Tree *t, long links, const double *bends, long parent) {
    if (t->count == t->capacity) {
        t->capacity = t->capacity ? 2 * t->capacity : 1024;
        t->bends = realloc(t->bends, sizeof(double) * (size_t)(t->capacity * links));
        t->parents = realloc(t->parents, sizeof(long) * (size_t)t->capacity);
    }
    memcpy(t->bends + t->count * links, bends, sizeof(double) * (size_t)links);
    t->parents[t->count] = parent;
    return t->count++;
}

static long nearest(const Tree *t, long links, const double *target) {
    long best = 0;
    double least = INFINITY;
    for (long k = 0; k < t->count; ++k) {
        double sum = 0.0;
        const double *node = t->bends + k * links;
        for (long i = 0; i < links; ++i) sum += (node[i] - target[i]) * (node[i] - target[i]);
        if (sum < least) {
            least = sum;
            best = k;
        }
    }
    return best;
}

/* One step of at most range: the new node, or -1; reached tells whether it is the target. */
static long extended(const Scene *s, Tree *t, const double *target, double range, int *reached, long *motions) {
    long from = nearest(t, s->links, target);
    const double *node = t->bends + from * s->links;
    double end[MOST_LINKS], length = 0.0;
    for (long i = 0; i < s->links; ++i) length += (target[i] - node[i]) * (target[i] - node[i]);
    length = sqrt(length);
    *reached = length <= range;
    for (long i = 0; i < s->links; ++i) end[i] = *reached ? target[i] : node[i] + range / length * (target[i] - node[i]);
    ++*motions;
    if (!motion_free(s, node, end)) return -1;
    return added(t, s->links, end, from);
}

static double uniform(uint64_t *state) {
    uint64_t z = (*state += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (double)((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
}

/* Number of poses of the way found, written to way (most, links); 0 when the time is up. */
long plain_connect(const Scene *s, const double *start, const double *goals, long goal_count, double range,
                   double seconds, uint64_t seed, double *way, long most, double *used, long *motions) {
    Tree trees[2] = {{0}};
    double begun = now(), target[MOST_LINKS];
    long found = 0, links = s->links;
    added(&trees[0], links, start, -1);
    for (long k = 0; k < goal_count; ++k) added(&trees[1], links, goals + k * links, -1);
    *motions = 0;
    for (long turn = 0; goal_count && !found && now() - begun < seconds; ++turn) {
        Tree *tree = &trees[turn % 2], *other = &trees[1 - turn % 2];
        int reached;
        for (long i = 0; i < links; ++i) target[i] = s->limits[i] * (2.0 * uniform(&seed) - 1.0);
        long node = extended(s, tree, target, range, &reached, motions), met = -1;
        if (node < 0) continue;
        memcpy(target, tree->bends + node * links, sizeof(double) * (size_t)links);
        do met = extended(s, other, target, range, &reached, motions);
        while (met >= 0 && !reached);
        if (met < 0) continue;
        long first = turn % 2 == 0 ? node : met, second = turn % 2 == 0 ? met : node, before = 0;
        for (long k = first; k >= 0; k = trees[0].parents[k]) ++before;
        long at = before;
        for (long k = first; k >= 0; k = trees[0].parents[k])
            if (--at < most) memcpy(way + at * links, trees[0].bends + k * links, sizeof(double) * (size_t)links);
        found = before;
        for (long k = second; k >= 0; k = trees[1].parents[k], ++found)
            if (found < most) memcpy(way + found * links, trees[1].bends + k * links, sizeof(double) * (size_t)links);
    }
    *used = now() - begun;
    for (int k = 0; k < 2; ++k) {
        free(trees[k].bends);
        free(trees[k].parents);
    }
    return found;
}
