/* Whether a text is rows of numbers, with the same words between them in every row: number_rows.py says what for.

   A number is digits with at most one point, a sign in front and an exponent behind. Its digits are a whole number below
   10^18 times a power of ten, which is right to some 1e-15 of it; whatever else stands there is left to others. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

#define MOST_DIGITS 18
#define MOST_POWER 400 /* of ten, beyond which every number is 0 or infinite */

typedef struct {
    const char *text;
    int64_t length;
    int64_t rows;
    int64_t parts;          /* the numbers of a row stand side by side in so many arrays */
    const double **wanted;  /* each (rows, width of the part) */
    const int64_t *widths;  /* (parts,) */
    const char *words;      /* what stands in front of each number of a row, and behind the last, without gaps */
    const int64_t *ends;    /* where each of these ends in words, (sum of widths + 1,) */
    double share;           /* of the wanted number by which one may differ */
    double least;           /* by which any number may differ */
    int64_t agree;          /* out: 1 where the text is so, 0 for all others */
} Rows;

/* A whole number times a power of ten; powers up to 10^22 are exact. */
static double scaled(uint64_t digits, int64_t power)
{
    static const double tens[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                  1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    double value = (double)digits;
    for (; power > 22; power -= 22) value *= 1e22;
    for (; power < -22; power += 22) value /= 1e22;
    return power < 0 ? value / tens[-power] : value * tens[power];
}

/* Reads digits on; how many there were. */
static int64_t digits_from(const char **at, const char *end, uint64_t *digits)
{
    const char *start = *at;
    const char *p = start;
    for (; p < end && *p >= '0' && *p <= '9' && p - start <= MOST_DIGITS; p++)
        *digits = 10 * *digits + (uint64_t)(*p - '0');
    *at = p;
    return p - start;
}

/* Reads the exponent behind a number, if there is one; 0 where it is none. */
static int exponent_from(const char **at, const char *end, int64_t *power)
{
    if (*at == end || **at != 'e') return 1;
    (*at)++;
    if (*at == end) return 0;
    int falls = **at == '-';
    if (falls || **at == '+') (*at)++;
    uint64_t exponent = 0;
    int64_t count = digits_from(at, end, &exponent);
    if (count == 0 || count > MOST_DIGITS || exponent > MOST_POWER) return 0;
    *power += falls ? -(int64_t)exponent : (int64_t)exponent;
    return 1;
}

/* Reads a number; 0 where there is none, or one of too many digits. */
static int number_from(const char **at, const char *end, double *value)
{
    int negative = *at < end && **at == '-';
    *at += negative;
    uint64_t digits = 0;
    int64_t power = 0;
    int64_t whole = digits_from(at, end, &digits);
    int64_t behind = 0;
    if (whole == 0 || whole > MOST_DIGITS) return 0;
    if (*at < end && **at == '.') {
        (*at)++;
        if (whole == 1 && digits == 0) whole = 0; /* a zero in front is no digit that counts */
        behind = digits_from(at, end, &digits);
        if (behind == 0 || whole + behind > MOST_DIGITS) return 0;
        power = -behind;
    }
    if (!exponent_from(at, end, &power)) return 0;
    *value = scaled(digits, power);
    if (negative) *value = -*value;
    return 1;
}

/* Steps over the words in front of a number; 0 where others stand there. */
static int words_from(const char **at, const char *end, const Rows *r, int64_t number)
{
    int64_t first = number ? r->ends[number - 1] : 0;
    int64_t count = r->ends[number] - first;
    if (end - *at < count) return 0;
    if (count == 1 ? **at != r->words[first] : memcmp(*at, r->words + first, (size_t)count) != 0) return 0;
    *at += count;
    return 1;
}

static int row_agrees(const char **at, const char *end, const Rows *r, int64_t row)
{
    int64_t number = 0;
    for (int64_t part = 0; part < r->parts; part++) {
        const double *wanted = r->wanted[part] + row * r->widths[part];
        for (int64_t k = 0; k < r->widths[part]; k++, number++) {
            double value;
            if (!words_from(at, end, r, number)) return 0;
            /* Two of three numbers of a motion in the plane are nothing but a zero. */
            if (wanted[k] == 0.0 && end - *at > 1 && (*at)[0] == '0' && (*at)[1] == ',') {
                (*at)++;
                continue;
            }
            if (!number_from(at, end, &value)) return 0;
            /* What is no number differs, and what is infinite from all that is not. */
            if (!(fabs(value - wanted[k]) <= r->share * fabs(wanted[k]) + r->least)) return 0;
        }
    }
    return words_from(at, end, r, number);
}

PUBLIC void compare_rows(Rows *r)
{
    const char *at = r->text;
    const char *end = at + r->length;
    r->agree = 0;
    for (int64_t row = 0; row < r->rows; row++)
        if (!row_agrees(&at, end, r, row)) return;
    r->agree = at == end;
}
