/* Fewer triangles for nearly the same surface, by collapsing edges: mesh_simplifying.py says why that is allowed.

   The fan of a vertex u is the ring of triangles about it. Collapsing the edge from u to its neighbour v replaces the
   fan by triangles from v to the sides of the fan's outline. Along one direction both are heights over the same outline,
   as long as no triangle of either turns over, and their largest difference is where two of their edges cross, or at u. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

#define WIDEST 24 /* triangles of a fan that is looked at; wider ones stay */

typedef struct {
    int64_t vertices, faces;
    const double *places; /* (vertices, 3) */
    int64_t *corners;     /* in and out, (faces, 3) */
    double *off;          /* out: what the old surface is off each new triangle at most, (faces,) */
    uint8_t *kept;        /* out: whether a triangle is left, (faces,) */
    double allowed;       /* of what the surface may be off */
    double steepest;      /* least cosine between the direction and the normal of a triangle */
    int64_t sweeps, levels;
    int64_t done;         /* out: 0 where memory ran out */
} Collapsing;

typedef struct {
    Collapsing *mesh;
    int64_t *first; /* first corner of every vertex, −1 for none; a corner is three times the triangle and its place */
    int64_t *next;  /* corner of the same vertex after each */
    uint8_t *moved; /* vertices that are left alone for the rest of a sweep */
} Corners;

typedef struct {
    int64_t vertex, count;
    int64_t ring[WIDEST], face[WIDEST]; /* triangle i is between ring i and ring i + 1 */
    double flat[WIDEST][2], height[WIDEST];
    double normal[3], centre[2], top;
    double off;
} Fan;

static void subtract(const double *a, const double *b, double *out)
{
    for (int k = 0; k < 3; k++) out[k] = a[k] - b[k];
}

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double turn(const double *a, const double *b, const double *c)
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static void normal_of(const double *a, const double *b, const double *c, double *out)
{
    double ab[3], ac[3];
    subtract(b, a, ab);
    subtract(c, a, ac);
    cross(ab, ac, out);
}

/* The triangles about a vertex in their order; 0 where they are no closed ring, or too many. */
static int fan_about(const Corners *c, int64_t vertex, Fan *fan)
{
    Collapsing *mesh = c->mesh;
    int64_t sides[WIDEST][2], faces[WIDEST], count = 0;
    fan->vertex = vertex;
    fan->off = 0.0;
    for (int64_t corner = c->first[vertex]; corner >= 0; corner = c->next[corner]) {
        int64_t face = corner / 3, place = corner % 3;
        if (!mesh->kept[face]) continue;
        if (count == WIDEST) return 0;
        faces[count] = face;
        sides[count][0] = mesh->corners[3 * face + (place + 1) % 3];
        sides[count][1] = mesh->corners[3 * face + (place + 2) % 3];
        if (mesh->off[face] > fan->off) fan->off = mesh->off[face];
        count++;
    }
    if (count < 3) return 0;
    fan->count = count;
    int64_t at = sides[0][0];
    uint8_t used[WIDEST] = {0};
    for (int64_t i = 0; i < count; i++) {
        int64_t found = -1;
        for (int64_t k = 0; k < count; k++) {
            if (used[k] || (sides[k][0] != at && sides[k][1] != at)) continue;
            found = k;
            if (i == 0 || sides[k][0] == at) break; /* the triangle that is turned alike, where there is one */
        }
        if (found < 0) return 0;
        used[found] = 1;
        fan->ring[i] = at;
        fan->face[i] = faces[found];
        at = sides[found][0] == at ? sides[found][1] : sides[found][0];
        for (int64_t k = 0; k < i; k++)
            if (fan->ring[k] == fan->ring[i]) return 0;
    }
    return at == fan->ring[0];
}

/* The fan as heights over a plane across its mean normal; 0 where it is none. */
static int laid_flat(const Collapsing *mesh, Fan *fan)
{
    const double *u = mesh->places + 3 * fan->vertex;
    double normals[WIDEST][3], sum[3] = {0.0, 0.0, 0.0};
    int64_t count = fan->count;
    for (int64_t i = 0; i < count; i++) {
        const double *a = mesh->places + 3 * fan->ring[i], *b = mesh->places + 3 * fan->ring[(i + 1) % count];
        normal_of(u, a, b, normals[i]);
        for (int k = 0; k < 3; k++) sum[k] += normals[i][k];
    }
    double size = sqrt(dot(sum, sum));
    if (!(size > 0.0)) return 0;
    for (int k = 0; k < 3; k++) fan->normal[k] = sum[k] / size;
    for (int64_t i = 0; i < count; i++) {
        double steep = dot(normals[i], fan->normal);
        if (!(steep > mesh->steepest * sqrt(dot(normals[i], normals[i])))) return 0;
    }
    /* Two directions across the normal. */
    double axis[3] = {0.0, 0.0, 0.0}, e[3], f[3];
    int least = fabs(fan->normal[0]) < fabs(fan->normal[1]) ? 0 : 1;
    if (fabs(fan->normal[2]) < fabs(fan->normal[least])) least = 2;
    axis[least] = 1.0;
    cross(axis, fan->normal, e);
    double length = sqrt(dot(e, e));
    for (int k = 0; k < 3; k++) e[k] /= length;
    cross(fan->normal, e, f);
    double around = 0.0;
    for (int64_t i = 0; i < count; i++) {
        double away[3];
        subtract(mesh->places + 3 * fan->ring[i], u, away);
        fan->flat[i][0] = dot(away, e);
        fan->flat[i][1] = dot(away, f);
        fan->height[i] = dot(away, fan->normal);
    }
    for (int64_t i = 0; i < count; i++) {
        const double *a = fan->flat[i], *b = fan->flat[(i + 1) % count];
        around += atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
    }
    /* A fan that goes round twice covers its outline twice. */
    return around < 6.5;
}

/* What the fan is off the triangles from its corner j, along the normal at most; negative where they turn over. */
static double off_from(const Collapsing *mesh, const Fan *fan, int64_t j)
{
    int64_t count = fan->count;
    const double zero[2] = {0.0, 0.0};
    const double *v = fan->flat[j], *place = mesh->places + 3 * fan->ring[j];
    double worst = 0.0;
    for (int64_t i = 0; i < count; i++) {
        int64_t after = (i + 1) % count;
        if (i == j || after == j) continue;
        const double *a = fan->flat[i], *b = fan->flat[after];
        double normal[3];
        normal_of(place, mesh->places + 3 * fan->ring[i], mesh->places + 3 * fan->ring[after], normal);
        double up = dot(normal, fan->normal);
        if (!(up > mesh->steepest * sqrt(dot(normal, normal)))) return -1.0;
        /* The vertex itself, whose height is 0, where this is the triangle below or above it. */
        double area = turn(v, a, b);
        if (!(area > 0.0)) return -1.0;
        double to_v = turn(zero, a, b), to_a = turn(v, zero, b), to_b = turn(v, a, zero);
        double slip = -1e-9 * area;
        if (to_v >= slip && to_a >= slip && to_b >= slip) {
            double height = (to_v * fan->height[j] + to_a * fan->height[i] + to_b * fan->height[after]) / area;
            if (fabs(height) > worst) worst = fabs(height);
        }
    }
    /* Old edges go from the origin to ring m, new ones from ring j to ring i. */
    for (int64_t i = 0; i < count; i++) {
        if (i == j || i == (j + 1) % count || (i + 1) % count == j) continue;
        double side[2] = {fan->flat[i][0] - v[0], fan->flat[i][1] - v[1]};
        for (int64_t m = 0; m < count; m++) {
            if (m == j || m == i) continue;
            const double *w = fan->flat[m];
            double down = w[0] * side[1] - w[1] * side[0];
            if (down == 0.0) continue; /* parallel edges cross at ends, if at all, and those are seen to */
            double along = (v[0] * side[1] - v[1] * side[0]) / down;
            double across = (v[0] * w[1] - v[1] * w[0]) / down;
            if (along < -1e-9 || along > 1.0 + 1e-9 || across < -1e-9 || across > 1.0 + 1e-9) continue;
            double apart = along * fan->height[m] - (fan->height[j] + across * (fan->height[i] - fan->height[j]));
            if (fabs(apart) > worst) worst = fabs(apart);
        }
    }
    return worst;
}

/* How near the worst of the new triangles is to an equilateral one, from 0 to 1. */
static double worst_shape(const Collapsing *mesh, const Fan *fan, int64_t j)
{
    double worst = 1.0;
    const double *v = mesh->places + 3 * fan->ring[j];
    for (int64_t i = 0; i < fan->count; i++) {
        int64_t after = (i + 1) % fan->count;
        if (i == j || after == j) continue;
        const double *a = mesh->places + 3 * fan->ring[i], *b = mesh->places + 3 * fan->ring[after];
        double normal[3], va[3], vb[3], ab[3];
        normal_of(v, a, b, normal);
        subtract(a, v, va);
        subtract(b, v, vb);
        subtract(b, a, ab);
        double shape = 2.0 * sqrt(3.0) * sqrt(dot(normal, normal)) / (dot(va, va) + dot(vb, vb) + dot(ab, ab));
        if (shape < worst) worst = shape;
    }
    return worst;
}

/* Whether the only neighbours that the vertex shares with ring j are the two beside it: else sheets would grow together. */
static int stays_a_surface(const Corners *c, const Fan *fan, int64_t j)
{
    Collapsing *mesh = c->mesh;
    int64_t count = fan->count, before = fan->ring[(j + count - 1) % count], after = fan->ring[(j + 1) % count];
    int64_t width = 0;
    for (int64_t corner = c->first[fan->ring[j]]; corner >= 0; corner = c->next[corner]) {
        int64_t face = corner / 3, place = corner % 3;
        if (!mesh->kept[face]) continue;
        if (++width > WIDEST) return 0;
        int64_t sides[2] = {mesh->corners[3 * face + (place + 1) % 3], mesh->corners[3 * face + (place + 2) % 3]};
        if (sides[0] == fan->vertex || sides[1] == fan->vertex) continue;
        int shared = 0;
        for (int k = 0; k < 2; k++)
            for (int64_t i = 0; i < count; i++)
                if (fan->ring[i] == sides[k]) {
                    shared++;
                    if (sides[k] != before && sides[k] != after) return 0;
                }
        if (shared == 2) return 0; /* the very triangle that would be made */
    }
    return width + count - 4 <= WIDEST;
}

static void collapse(Corners *c, const Fan *fan, int64_t j, double off)
{
    Collapsing *mesh = c->mesh;
    int64_t v = fan->ring[j];
    for (int64_t corner = c->first[fan->vertex]; corner >= 0;) {
        int64_t face = corner / 3, after = c->next[corner];
        if (mesh->kept[face]) {
            int64_t *corners = mesh->corners + 3 * face;
            if (corners[0] == v || corners[1] == v || corners[2] == v) {
                mesh->kept[face] = 0;
            } else {
                mesh->corners[corner] = v;
                mesh->off[face] = off;
                c->next[corner] = c->first[v];
                c->first[v] = corner;
            }
        }
        corner = after;
    }
    c->first[fan->vertex] = -1;
    for (int64_t i = 0; i < fan->count; i++) c->moved[fan->ring[i]] = 1;
}

/* Try to take a vertex away while the surface is off by no more than the limit. */
static int taken_away(Corners *c, int64_t vertex, double limit)
{
    Fan fan;
    if (!fan_about(c, vertex, &fan) || fan.off > limit || !laid_flat(c->mesh, &fan)) return 0;
    double best = -1.0, off = 0.0;
    int64_t chosen = -1;
    for (int64_t j = 0; j < fan.count; j++) {
        double here = off_from(c->mesh, &fan, j);
        if (here < 0.0 || fan.off + here > limit) continue;
        /* Of those that are near enough the one with the best triangles, near ones rather than far ones. */
        double worth = worst_shape(c->mesh, &fan, j) * (1.0 - 0.5 * (limit > 0.0 ? here / limit : 0.0));
        if (worth > best && stays_a_surface(c, &fan, j)) {
            best = worth;
            off = here;
            chosen = j;
        }
    }
    if (chosen < 0) return 0;
    collapse(c, &fan, chosen, fan.off + off);
    return 1;
}

PUBLIC void collapse_edges(Collapsing *mesh)
{
    Corners c = {mesh, malloc(sizeof(int64_t) * (size_t)mesh->vertices), malloc(sizeof(int64_t) * 3 * (size_t)mesh->faces),
                 malloc((size_t)mesh->vertices)};
    mesh->done = c.first && c.next && c.moved;
    if (mesh->done) {
        for (int64_t v = 0; v < mesh->vertices; v++) c.first[v] = -1;
        for (int64_t corner = 3 * mesh->faces - 1; corner >= 0; corner--) {
            c.next[corner] = c.first[mesh->corners[corner]];
            c.first[mesh->corners[corner]] = corner;
        }
        for (int64_t face = 0; face < mesh->faces; face++) {
            mesh->kept[face] = 1;
            mesh->off[face] = 0.0;
        }
        /* What changes nothing comes first, then more and more. */
        for (int64_t level = 0; level < mesh->levels; level++) {
            double limit = mesh->allowed * ldexp(1.0, (int)(level + 1 - mesh->levels));
            for (int64_t sweep = 0; sweep < mesh->sweeps; sweep++) {
                int64_t taken = 0, left = 0;
                memset(c.moved, 0, (size_t)mesh->vertices);
                for (int64_t v = 0; v < mesh->vertices; v++) {
                    if (c.first[v] < 0) continue;
                    left++;
                    if (!c.moved[v]) taken += taken_away(&c, v, limit);
                }
                if (64 * taken <= left) break;
            }
        }
    }
    free(c.first);
    free(c.next);
    free(c.moved);
}
