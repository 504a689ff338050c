/* Rows of numbers as a text, every number of twelve digits as printf's %.12g has them: number_writing.py says what for.

   A number is m 2^e with whole m. Times the power of ten that leaves twelve digits in front of the point it is
   m 5^k 2^(e + k): the product m 5^k is a whole number that is reckoned to its last bit, and the power of two cuts it
   into the digits and what is rounded off, halves to even digits. So no number is rounded twice. */

#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC __attribute__((visibility("default")))
#endif

#define DIGITS 12
#define BEYOND 1000000000000ULL /* the least whole number of more digits */
#define LEAST_POWER (-4)        /* numbers below this power of ten have an exponent, as have those beyond all digits */
#define LIMBS 32                /* of 32 bits: 53 bits times 5^335, for the least number of all, take 27 */

typedef struct {
    const double *table; /* (rows, width) */
    const uint8_t *idle; /* (width,), 1 for columns of zeros, whose sign is not written */
    int64_t rows;
    int64_t width;
    char *text;     /* out: 20 letters for every number, and one for every row */
    int64_t length; /* out: of the text; -1 where a number is too large or none, and the text is left to others */
} Writing;

/* A whole number in parts of 32 bits, the least first. */
typedef struct {
    uint32_t limbs[LIMBS];
    int count;
} Whole;

static void multiply(Whole *w, uint32_t factor)
{
    uint64_t carry = 0;
    for (int i = 0; i < w->count; i++) {
        carry += (uint64_t)w->limbs[i] * factor;
        w->limbs[i] = (uint32_t)carry;
        carry >>= 32;
    }
    if (carry) w->limbs[w->count++] = (uint32_t)carry;
}

static uint64_t limb(const Whole *w, int i)
{
    return i < w->count ? w->limbs[i] : 0;
}

/* The number without its last bits, of which no more than 64 are left. */
static uint64_t without(const Whole *w, int bits)
{
    int first = bits / 32;
    int within = bits % 32;
    uint64_t low = limb(w, first) | limb(w, first + 1) << 32;
    return within ? low >> within | limb(w, first + 2) << (64 - within) : low;
}

/* Whether the last bits are more than a half, or a half behind an odd number. */
static int goes_up(const Whole *w, int bits, uint64_t front)
{
    int half = bits - 1;
    uint64_t first = limb(w, half / 32);
    if (!(first >> half % 32 & 1)) return 0;
    if (front & 1 || first & ((1ULL << half % 32) - 1)) return 1;
    for (int i = 0; i < half / 32; i++)
        if (limb(w, i)) return 1;
    return 0;
}

/* The digits of m 2^e, below 10^12, as a whole number, and the power of ten of the first of them. */
static uint64_t digits_of(uint64_t m, int e, int *power)
{
    static const uint32_t fives[] = {1,     5,      25,      125,     625,      3125,      15625,
                                     78125, 390625, 1953125, 9765625, 48828125, 244140625, 1220703125};
    int size = 52;
    while (!(m >> size)) size--;
    int exponent = size + e;
    /* The power of ten of 2^exponent, by log10(2) = 78913 / 2^18, right for all doubles; the number's own may be one
       more. */
    *power = exponent >= 0 ? exponent * 78913 >> 18 : -((-exponent * 78913 + 262143) >> 18);
    for (;; (*power)++) {
        int fifth = DIGITS - 1 - *power;
        int bits = -(e + fifth);
        Whole w; /* most of which stays empty */
        w.limbs[0] = (uint32_t)m;
        w.limbs[1] = (uint32_t)(m >> 32);
        w.count = 2;
        for (; fifth > 13; fifth -= 13) multiply(&w, fives[13]);
        multiply(&w, fives[fifth]);
        uint64_t digits = without(&w, bits);
        if (digits >= BEYOND) continue;
        digits += (uint64_t)goes_up(&w, bits, digits);
        if (digits < BEYOND) return digits;
        (*power)++;
        return digits / 10;
    }
}

static char *copied(char *to, const char *letters, int count)
{
    memcpy(to, letters, (size_t)count);
    return to + count;
}

/* Digits behind the point up to the last that is no zero, or one zero. */
static char *behind_point(char *to, const char *digits, int count)
{
    while (count > 1 && digits[count - 1] == '0') count--;
    *to++ = '.';
    if (count < 1) *to++ = '0';
    return copied(to, digits, count > 0 ? count : 0);
}

static char *number_to(char *to, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    if (bits >> 63) *to++ = '-';
    if (value == 0.0) return copied(to, "0.0", 3);
    int stored = (int)(bits >> 52 & 2047);
    uint64_t m = (bits & ((1ULL << 52) - 1)) | (uint64_t)(stored > 0) << 52;
    int power;
    uint64_t whole = digits_of(m, (stored > 0 ? stored : 1) - 1075, &power);
    char digits[DIGITS];
    uint32_t halves[2] = {(uint32_t)(whole / 1000000), (uint32_t)(whole % 1000000)};
    for (int i = DIGITS / 2 - 1; i >= 0; i--)
        for (int half = 0; half < 2; half++) {
            digits[i + half * DIGITS / 2] = (char)('0' + halves[half] % 10);
            halves[half] /= 10;
        }
    if (power >= LEAST_POWER && power < 0) {
        to = copied(to, "0.0000", 1 - power);
        int count = DIGITS;
        while (digits[count - 1] == '0') count--;
        return copied(to, digits, count);
    }
    int front = power >= 0 && power < DIGITS ? power + 1 : 1;
    to = copied(to, digits, front);
    to = behind_point(to, digits + front, DIGITS - front);
    if (front == power + 1) return to;
    *to++ = 'e';
    *to++ = power < 0 ? '-' : '+';
    int size = power < 0 ? -power : power;
    if (size >= 100) *to++ = (char)('0' + size / 100);
    *to++ = (char)('0' + size / 10 % 10);
    *to++ = (char)('0' + size % 10);
    return to;
}

PUBLIC void write_rows(Writing *w)
{
    char *to = w->text;
    const double *value = w->table;
    w->length = -1;
    for (int64_t row = 0; row < w->rows; row++) {
        for (int64_t k = 0; k < w->width; k++, value++) {
            /* What is no number is not below anything. */
            if (!(*value < (double)BEYOND && *value > -(double)BEYOND)) return;
            if (k) *to++ = ',';
            to = w->idle[k] ? copied(to, "0.0", 3) : number_to(to, *value);
        }
        *to++ = '\n';
    }
    w->length = to - w->text;
}
