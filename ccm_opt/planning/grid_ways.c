/* Cheapest ways through the cells of a grid (A*): grid_ways.py says of what. Cells touch by faces, edges and corners. */

#include "native.h"
#include <time.h>

typedef struct {
    int64_t nx, ny, nz, start, goal;
    const float *price;    /* of a way through a cell as a multiple of its length; not positive where it is blocked */
    const float *room;     /* distance of the middle of each cell from the surfaces, in cells */
    double least;          /* the lowest price of any cell, which makes the estimate of what is left a lower bound */
    double most_time;      /* CPU time after which the search ends [s] */
    int64_t *before;       /* out: the cell before each on its cheapest way, −1 where none is known, (cells,) */
    float *cost;           /* working memory, (cells,) */
    int64_t *heap;         /* working memory, (capacity,) */
    float *key;            /* likewise */
    int64_t capacity, found; /* found: 1 where the goal was reached, −1 where the heap is too small, −2 where the time ended */
} WayQuery;

typedef struct {
    int64_t *cell;
    float *key;
    int64_t count;
} Heap;

static void push(Heap *h, int64_t cell, float key)
{
    int64_t at = h->count++;
    while (at && h->key[(at - 1) / 2] > key) {
        h->key[at] = h->key[(at - 1) / 2];
        h->cell[at] = h->cell[(at - 1) / 2];
        at = (at - 1) / 2;
    }
    h->key[at] = key;
    h->cell[at] = cell;
}

static int64_t pop(Heap *h)
{
    int64_t top = h->cell[0], cell = h->cell[--h->count], at = 0;
    float key = h->key[h->count];
    for (;;) {
        int64_t child = 2 * at + 1;
        if (child >= h->count) break;
        if (child + 1 < h->count && h->key[child + 1] < h->key[child]) child++;
        if (h->key[child] >= key) break;
        h->key[at] = h->key[child];
        h->cell[at] = h->cell[child];
        at = child;
    }
    h->key[at] = key;
    h->cell[at] = cell;
    return top;
}

/* Whether the time is over; the clock is looked at now and then. */
static int too_late(clock_t begin, double most_time, int64_t round)
{
    return round % 4096 == 0 && (double)(clock() - begin) > most_time * (double)CLOCKS_PER_SEC;
}

PUBLIC void cheapest_way(WayQuery *q)
{
    clock_t begin = clock();
    int64_t cells = q->nx * q->ny * q->nz, goal[3] = {q->goal / (q->ny * q->nz), q->goal / q->nz % q->ny, q->goal % q->nz};
    for (int64_t k = 0; k < cells; k++) {
        q->cost[k] = INFINITY;
        q->before[k] = -1;
    }
    Heap heap = {q->heap, q->key, 0};
    q->found = 0;
    q->cost[q->start] = 0.0f;
    q->before[q->start] = q->start;
    push(&heap, q->start, 0.0f);
    /* A cell whose way is settled gets the negative of its cost, so that it is not looked at again. */
    for (int64_t round = 1; heap.count; round++) {
        if (too_late(begin, q->most_time, round)) {
            q->found = -2;
            return;
        }
        int64_t cell = pop(&heap);
        if (q->cost[cell] < 0.0f || signbit(q->cost[cell])) continue;
        float cost = q->cost[cell];
        q->cost[cell] = -cost;
        if (cell == q->goal) {
            q->found = 1;
            return;
        }
        int64_t x = cell / (q->ny * q->nz), y = cell / q->nz % q->ny, z = cell % q->nz;
        for (int64_t dx = -1; dx <= 1; dx++)
            for (int64_t dy = -1; dy <= 1; dy++)
                for (int64_t dz = -1; dz <= 1; dz++) {
                    int64_t i = x + dx, j = y + dy, k = z + dz;
                    if (i < 0 || j < 0 || k < 0 || i >= q->nx || j >= q->ny || k >= q->nz) continue;
                    int64_t next = (i * q->ny + j) * q->nz + k;
                    if (q->price[next] <= 0.0f || signbit(q->cost[next])) continue;
                    float length = sqrtf((float)(dx * dx + dy * dy + dz * dz));
                    /* Balls about both middles that do not meet may have a thin wall between them. */
                    if (q->room[cell] + q->room[next] < length) continue;
                    float trial = cost + 0.5f * length * (q->price[cell] + q->price[next]);
                    if (!(trial < q->cost[next])) continue;
                    if (heap.count >= q->capacity) {
                        q->found = -1;
                        return;
                    }
                    q->cost[next] = trial;
                    q->before[next] = cell;
                    double left = sqrt((double)((i - goal[0]) * (i - goal[0]) + (j - goal[1]) * (j - goal[1])
                                                + (k - goal[2]) * (k - goal[2])));
                    push(&heap, next, trial + (float)(q->least * left));
                }
    }
}
