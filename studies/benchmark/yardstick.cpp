// The paper's double pendulum in plain C++: how fast one core can be, for comparison.
//
//     g++ -std=gnu++17 -O3 -march=native -ffast-math -o yardstick yardstick.cpp
//     ./yardstick WIDTH SPAN RTOL RUNS LEAST MOST ROUNDS
//
// Simulates RUNS radial clearances from LEAST to MOST (m, spaced by their logarithm) for SPAN
// seconds each, WIDTH (1 or 8) of them side by side, and prints as JSON the least processor time of
// ROUNDS rounds and of each run its counts, first impact and end. The method is that of
// clearjoint's runs: Tsit5 with error control, contacts found on the dense output and landed on,
// entry speeds remembered. There are no records, energies or derivatives, onsets are landed on to
// the dense output's accuracy only, and the equations are derived by hand for this mechanism: less
// work in each step than clearjoint does.
//
// Everything is written once for a number type `Real`: double, or a vector of eight doubles, one
// for each of eight runs. Only the arithmetic of a step is done in `Real`; what follows a step (is
// it accepted, did a contact begin or end, how long is the next one) is decided run by run.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <memory>
#include <type_traits>
#include <vector>
#ifdef __AVX512F__
#include <immintrin.h>
#endif

#define INLINE inline __attribute__((always_inline))

typedef double Eight __attribute__((vector_size(64)));

INLINE double root(double x) { return std::sqrt(x); }
INLINE double larger(double a, double b) { return a > b ? a : b; }
INLINE double lane(const double &x, int) { return x; }
INLINE void set_lane(double &x, int, double value) { x = value; }

INLINE Eight root(Eight x) {
#ifdef __AVX512F__
    return (Eight)_mm512_sqrt_pd((__m512d)x);
#else
    for (int k = 0; k < 8; k++) x[k] = std::sqrt(x[k]);
    return x;
#endif
}
INLINE Eight larger(Eight a, Eight b) { return a > b ? a : b; }
INLINE double lane(const Eight &x, int k) { return x[k]; }
INLINE void set_lane(Eight &x, int k, double value) { x[k] = value; }

// ---- the mechanism

constexpr double MASS = 7.02, GRAVITY = 9.81, HALF = 0.5;  // kg, m/s^2, m: of each arm
constexpr double BROAD = 0.5855, SLENDER = 0.0010;         // kg m^2: across and along an arm
constexpr double RADIUS = 10e-3, HALF_JOURNAL = 10e-3;     // m: of the bearing; from centre to base
constexpr double YOUNG = 207e9, POISSON = 0.3, RESTITUTION = 0.9;

// Of Lankarani and Nikravesh's law: damping over entry speed; and Ravn's stiffness, N/m^1.5.
constexpr double DAMPING = 0.75 * (1.0 - RESTITUTION * RESTITUTION);
double stiffness(double clearance) {
    const double compliance = (1.0 - POISSON * POISSON) / YOUNG;
    return 4.0 / (6.0 * compliance) * std::sqrt(RADIUS * (RADIUS - clearance) / clearance);
}

// State of a run: position of the journal's centre 0-2; Euler parameters of arm 2, scalar first,
// 3-6; cosine and sine of the hinge's angle 7-8; velocity of the journal's centre 9-11; angular
// velocity of arm 2 in its own axes 12-14; rate of the hinge's angle 15.
constexpr int SIZE = 16;

template <class Real> struct Vector {
    Real x, y, z;
    INLINE Vector operator+(Vector b) const { return {x + b.x, y + b.y, z + b.z}; }
    INLINE Vector operator-(Vector b) const { return {x - b.x, y - b.y, z - b.z}; }
    INLINE Vector operator*(Real s) const { return {x * s, y * s, z * s}; }
};
template <class Real> INLINE Real dot(Vector<Real> a, Vector<Real> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class Real> INLINE Vector<Real> cross(Vector<Real> a, Vector<Real> b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// The rows of the rotation matrix of arm 2, from its axes to the ground's.
template <class Real> struct Rotation {
    Vector<Real> first, second, third;
};
template <class Real> INLINE Rotation<Real> rotation(const Real *y) {
    const Real a = y[3], b = y[4], c = y[5], d = y[6];
    return {{1.0 - 2.0 * (c * c + d * d), 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)},
        {2.0 * (b * c + a * d), 1.0 - 2.0 * (b * b + d * d), 2.0 * (c * d - a * b)},
        {2.0 * (b * d - a * c), 2.0 * (c * d + a * b), 1.0 - 2.0 * (b * b + c * c)}};
}

// What runs side by side differ in. An open contact has stiffness and damping zero.
template <class Real> struct Contacts {
    Real clearance, stiffness[2], damping[2];  // m, N/m^1.5, s/m
    bool any = true;                           // whether one of them is closed
};

// A base's penetration (negative in flight), its rate, and the force on the journal.
template <class Real> struct Base {
    Real depth, rate, force_x, force_y;
};

// Base 0 lies at one end of the journal, base 1 at the other.
template <class Real> INLINE Base<Real> base(
    const Contacts<Real> &contacts, int number, const Real *y, const Rotation<Real> &r) {
    const double along = number ? HALF_JOURNAL : -HALF_JOURNAL;
    const Real offset_x = y[0] + along * r.first.z, offset_y = y[1] + along * r.second.z;
    const Real speed_x = y[9] + along * (y[13] * r.first.x - y[12] * r.first.y);
    const Real speed_y = y[10] + along * (y[13] * r.second.x - y[12] * r.second.y);
    // The summand keeps the inverse finite where the journal is centred.
    const Real eccentricity = root(offset_x * offset_x + offset_y * offset_y + 1e-60);
    const Real inverse = 1.0 / eccentricity;
    const Real normal_x = offset_x * inverse, normal_y = offset_y * inverse;
    const Real depth = eccentricity - contacts.clearance;
    const Real rate = normal_x * speed_x + normal_y * speed_y;
    const Real positive = larger(depth, Real{});
    const Real force = contacts.stiffness[number] * positive * root(positive) *
                       (1.0 + contacts.damping[number] * rate);
    return {depth, rate, -(force * normal_x), -(force * normal_y)};
}

// Rates of the state. In axes of arm 2 the hinge's axis is u = (1, 0, 0), arm 3 points along
// `along`, its centre lies `apart` from that of arm 2, and `slope` is the derivative of `apart` by
// the hinge's angle. Unknown are the angular acceleration of arm 2 and that of the hinge; both arms
// turn about their common centre of mass, which the contact forces move.
template <class Real> INLINE void right_hand_side(
    const Contacts<Real> &contacts, const Real *__restrict y, Real *__restrict rates) {
    using V = Vector<Real>;
    constexpr double reduced = 0.5 * MASS, difference = BROAD - SLENDER;
    const Real zero{}, one = zero + 1.0, half = zero + HALF;
    const Rotation<Real> r = rotation(y);
    const Real cosine = y[7], sine = y[8], turning = y[15];
    const V spin = {y[12], y[13], y[14]}, u = {one, zero, zero}, along = {zero, -sine, cosine};
    const V swing = along * half, apart = V{half, zero, zero} + swing;
    const V slope = V{zero, -cosine, -sine} * half;
    const V centre = V{half, zero, zero} + apart * (zero + 0.5);  // of mass, from the journal

    V force = {zero, zero, zero}, torque = {zero, zero, zero};  // in axes of arm 2
    if (std::is_same_v<Real, Eight> || contacts.any) {
        const Base<Real> v = base(contacts, 0, y, r), w = base(contacts, 1, y, r);
        // Both forces lie in the ground's XY plane; their difference turns arm 2 about its journal.
        const auto in_arm = [&](Real x, Real y) { return r.first * x + r.second * y; };
        const V couple =
            in_arm(w.force_x - v.force_x, w.force_y - v.force_y) * (zero + HALF_JOURNAL);
        force = in_arm(v.force_x + w.force_x, v.force_y + w.force_y);
        torque = cross(force, centre) + V{-couple.y, couple.x, zero};  // about the centre of mass
    }

    const auto inertia_3 = [&](V v) {
        return v * (zero + BROAD) - along * (difference * dot(along, v));
    };
    const V spin_3 = spin + u * turning;
    // Without the unknown accelerations: that of arm 3's centre beside arm 2's, and arm 3's torque.
    const V relative = cross(spin, cross(spin, apart)) + cross(spin, slope) * (2.0 * turning) -
                       swing * (turning * turning);
    const V gyroscopic = inertia_3(cross(spin, u) * turning) -
                         cross(spin_3, along) * (difference * dot(along, spin_3));
    const V momentum_2 = {SLENDER * spin.x, BROAD * spin.y, BROAD * spin.z};

    // The linear system of both: [inertia, coupling; coupling, hinge_inertia] (turn, bend) =
    // (arm, hinge), from which `bend` is eliminated.
    const V arm =
        torque - cross(spin, momentum_2) - gyroscopic - cross(apart, relative) * (zero + reduced);
    const Real hinge =
        -0.5 * dot(slope, force) - dot(u, gyroscopic) - reduced * dot(slope, relative);
    constexpr double hinge_inertia = BROAD + reduced * HALF * HALF, inverse = 1.0 / hinge_inertia;
    const V coupling = inertia_3(u) + cross(apart, slope) * (zero + reduced);
    const Real spread = reduced * dot(apart, apart);
    const auto entry = [&](Real diagonal, Real a, Real b, Real p, Real q, Real s, Real t) {
        return diagonal - difference * a * b - reduced * p * q - s * t * inverse;
    };
    const Real xx =
        entry(SLENDER + BROAD + spread, along.x, along.x, apart.x, apart.x, coupling.x, coupling.x);
    const Real yy =
        entry(2.0 * BROAD + spread, along.y, along.y, apart.y, apart.y, coupling.y, coupling.y);
    const Real zz =
        entry(2.0 * BROAD + spread, along.z, along.z, apart.z, apart.z, coupling.z, coupling.z);
    const Real xy = entry(zero, along.x, along.y, apart.x, apart.y, coupling.x, coupling.y);
    const Real xz = entry(zero, along.x, along.z, apart.x, apart.z, coupling.x, coupling.z);
    const Real yz = entry(zero, along.y, along.z, apart.y, apart.z, coupling.y, coupling.z);
    const V right = arm - coupling * (hinge * inverse);
    // The inverse of the symmetric matrix by its cofactors.
    const Real cxx = yy * zz - yz * yz, cxy = xz * yz - xy * zz, cxz = xy * yz - xz * yy;
    const Real cyy = xx * zz - xz * xz, cyz = xy * xz - xx * yz, czz = xx * yy - xy * xy;
    const Real over = 1.0 / (xx * cxx + xy * cxy + xz * cxz);
    const V turn = V{cxx * right.x + cxy * right.y + cxz * right.z,
                       cxy * right.x + cyy * right.y + cyz * right.z,
                       cxz * right.x + cyz * right.y + czz * right.z} *
                   over;
    const Real bend = (hinge - dot(coupling, turn)) * inverse;
    const V journal = force * (zero + 0.5 / MASS) - cross(turn, centre) - slope * (0.5 * bend) -
                      cross(spin, cross(spin, V{half, zero, zero})) - relative * (zero + 0.5);

    const Real a = y[3], b = y[4], c = y[5], d = y[6];
    rates[0] = y[9];
    rates[1] = y[10];
    rates[2] = y[11];
    rates[3] = -0.5 * (b * spin.x + c * spin.y + d * spin.z);
    rates[4] = 0.5 * (a * spin.x - d * spin.y + c * spin.z);
    rates[5] = 0.5 * (d * spin.x + a * spin.y - b * spin.z);
    rates[6] = 0.5 * (b * spin.y - c * spin.x + a * spin.z);
    rates[7] = -(turning * sine);
    rates[8] = turning * cosine;
    rates[9] = dot(r.first, journal);
    rates[10] = dot(r.second, journal) + GRAVITY;
    rates[11] = dot(r.third, journal);
    rates[12] = turn.x;
    rates[13] = turn.y;
    rates[14] = turn.z;
    rates[15] = bend;
}

// Takes Euler parameters, and cosine and sine, back to length one.
template <class Real> INLINE void normalise(Real *y) {
    const Real whole = 1.0 / root(y[3] * y[3] + y[4] * y[4] + y[5] * y[5] + y[6] * y[6]);
    for (int i = 3; i < 7; i++) y[i] = y[i] * whole;
    const Real circle = 1.0 / root(y[7] * y[7] + y[8] * y[8]);
    y[7] = y[7] * circle;
    y[8] = y[8] * circle;
}

// ---- the step of Tsit5

// A step of order five (Tsitouras 2011); k[6] is the right-hand side at its end.
template <class Real> struct Step {
    alignas(64) Real before[SIZE], after[SIZE], k[7][SIZE];
    Real length;

    __attribute__((noinline)) void take(const Contacts<Real> &contacts) {
        static constexpr double A[6][6] = {{0.161}, {-0.008480655492356989, 0.335480655492357},
            {2.8971530571054935, -6.359448489975075, 4.3622954328695815},
            {5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525},
            {5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401,
                -0.028269050394068383},
            {0.09646076681806523, 0.01, 0.4798896504144996, 1.379008574103742, -3.290069515436081,
                2.324710524099774}};
        stage<1>(contacts, A[0]);
        stage<2>(contacts, A[1]);
        stage<3>(contacts, A[2]);
        stage<4>(contacts, A[3]);
        stage<5>(contacts, A[4]);
        stage<6>(contacts, A[5]);
    }

    template <int NUMBER> INLINE void stage(const Contacts<Real> &contacts, const double *weights) {
        alignas(64) Real at[SIZE];
        for (int i = 0; i < SIZE; i++) at[i] = before[i] + length * weighted<NUMBER>(weights, i);
        right_hand_side(contacts, at, k[NUMBER]);
        if (NUMBER == 6) std::copy(at, at + SIZE, after);
    }

    template <int COUNT> INLINE Real weighted(const double *weights, int i) const {
        if constexpr (COUNT == 1)
            return weights[0] * k[0][i];
        else
            return weighted<COUNT - 1>(weights, i) + weights[COUNT - 1] * k[COUNT - 1][i];
    }

    // Of the embedded method of order four, in tolerances; up to 1 is accepted.
    Real error(double rtol, double atol) const {
        static constexpr double E[7] = {-0.00178001105222577714, -0.0008164344596567469,
            0.007880878010261995, -0.1447110071732629, 0.5823571654525552, -0.45808210592918697,
            0.015151515151515152};
        Real total{};
        for (int i = 0; i < SIZE; i++) {
            const Real size = larger(larger(before[i], -before[i]), larger(after[i], -after[i]));
            const Real share = length * weighted<7>(E, i) / (atol + rtol * size);
            total += share * share;
        }
        return root(total * (1.0 / SIZE));
    }
};

// The dense output of order four of one run's step.
struct Dense {
    double before[SIZE], k[7][SIZE], length;

    template <class Real> Dense(const Step<Real> &step, int number)
        : length(lane(step.length, number)) {
        for (int i = 0; i < SIZE; i++) {
            before[i] = lane(step.before[i], number);
            for (int j = 0; j < 7; j++) k[j][i] = lane(step.k[j][i], number);
        }
    }

    // The state at a share x of the step.
    void at(double x, double *y) const {
        const double squared = x * x;
        const double weights[7] = {-1.0530884977290216 * x * (x - 1.3299890189751412) *
                                       (squared - 1.4364028541716351 * x + 0.7139816917074209),
            0.1017 * squared * (squared - 2.1966568338249754 * x + 1.2949852507374631),
            2.490627285651252793 * squared *
                (squared - 2.38535645472061657 * x + 1.57803468208092486),
            -16.54810288924490272 * (x - 1.21712927295533244) * (x - 0.61620406037800089) * squared,
            47.37952196281928122 * (x - 1.203071208372362603) * (x - 0.658047292653547382) *
                squared,
            -34.87065786149660974 * (x - 1.2) * (x - 0.666666666666666667) * squared,
            2.5 * (x - 1.0) * (x - 0.6) * squared};
        for (int i = 0; i < SIZE; i++) {
            double sum = 0.0;
            for (int j = 0; j < 7; j++) sum += weights[j] * k[j][i];
            y[i] = before[i] + length * sum;
        }
        normalise(y);
    }
};

// ---- what happens after a step

constexpr double LONGEST = 1e-2, FIRST = 1e-3, ONSET = 2e-6;  // s: steps at most, first, in contact
constexpr double NEAR = 1e-3;  // of the clearance: below it a contact may begin within a step
constexpr double LEAST_SPEED = 1e-12;  // m/s, of entry

// A contact whose law would pull (a fast separation) is cut: it has no force until it pushes again.
enum Phase { OPEN, CLOSED, CUT };
enum Event { BEGIN_OR_END, CUT_OR_NOT };

struct Gap {
    double depth, rate;
};

struct Result {
    long accepted = 0, rejected = 0, onsets = 0;
    double first_onset = NAN, first_speed = NAN, state[SIZE];
};

// One run on its way: `gaps` are those at the start of the next step.
struct Run {
    int number = -1;  // of its result; -1: there is nothing to do
    double clearance = 1.0, stiff = 0.0, time = 0.0;
    Phase phase[2] = {OPEN, OPEN};
    double entry_speed[2] = {1.0, 1.0};
    Gap gaps[2];
    bool switched[2] = {false, false};  // whether the last step ended where the contact changed
    bool rejected = false, begins_contact = false, last = false;
    double step_in_flight = LONGEST, step_at_onset = 0.0;

    double factor(int b) const { return phase[b] == OPEN ? 0.0 : DAMPING / entry_speed[b]; }

    // Positive once the event has happened; and its rate.
    double passed(const Gap *gaps, int b) const {
        return phase[b] == OPEN ? gaps[b].depth : -gaps[b].depth;
    }
    double passing(const Gap *gaps, int b) const {
        return phase[b] == OPEN ? gaps[b].rate : -gaps[b].rate;
    }
    double cut(const Gap *gaps, int b) const {
        const double push = 1.0 + factor(b) * gaps[b].rate;
        return phase[b] == OPEN ? -1.0 : phase[b] == CLOSED ? -push : push;
    }

    void gaps_of(const double *y, Gap *found) const {
        Contacts<double> none{};
        none.clearance = clearance;
        const Rotation<double> r = rotation(y);
        for (int b = 0; b < 2; b++) {
            const Base<double> there = base(none, b, y, r);
            found[b] = {there.depth, there.rate};
        }
    }

    // The greatest value within the step of the cubic through the event function and its rates.
    static double most_between(
        double start, double start_rate, double end, double end_rate, double length) {
        const double a = length * start_rate, b = length * end_rate;
        const double cubic = 2.0 * (start - end) + a + b,
                     square = -3.0 * (start - end) - 2.0 * a - b;
        double low = 0.0, high = 1.0;
        for (int i = 0; i < 12; i++) {
            const double x = 0.5 * (low + high);
            (a + x * (2.0 * square + 3.0 * cubic * x) > 0.0 ? low : high) = x;
        }
        const double x = 0.5 * (low + high);
        return start + x * (a + x * (square + x * cubic));
    }

    bool may_touch_between(const Gap *end, int b, double length) const {
        const double start_rate = passing(gaps, b), end_rate = passing(end, b);
        return start_rate > 0.0 && end_rate < 0.0 &&
               most_between(passed(gaps, b), start_rate, passed(end, b), end_rate, length) >
                   -NEAR * clearance;
    }

    bool eventful(const Gap *end, double length) const {
        for (int b = 0; b < 2; b++)
            if (passed(end, b) > 0.0 || may_touch_between(end, b, length) || cut(end, b) > 0.0)
                return true;
        return false;
    }

    // Where a function of the gaps becomes positive, as a share of the step (Illinois' method).
    template <class Function>
    double zero(const Dense &dense, Function function, double low, double high) const {
        double y[SIZE];
        Gap there[2];
        const auto value = [&](double x) {
            dense.at(x, y);
            gaps_of(y, there);
            return function(there);
        };
        double at_low = value(low), at_high = value(high);
        if (at_low > 0.0) return low;
        if (at_high <= 0.0) return high;
        for (int i = 0, side = 0; i < 60 && high - low >= 1e-15; i++) {
            double x = (low * at_high - high * at_low) / (at_high - at_low);
            if (i % 4 == 3 || !(x > low && x < high)) x = 0.5 * (low + high);
            const double there = value(x);
            if (std::fabs(there) < 1e-18) return x;
            if (there > 0.0) {
                high = x, at_high = there;
                if (side == 1) at_low *= 0.5;
                side = 1;
            } else {
                low = x, at_low = there;
                if (side == -1) at_high *= 0.5;
                side = -1;
            }
        }
        return high;
    }

    // The first event of a step with these gaps at its end: its share of the step, above 1 if there
    // is none, whose it is, and which.
    double first_event(const Dense &dense, const Gap *end, int &whose, Event &which) const {
        double first = 2.0, y[SIZE];
        Gap there[2];
        for (int b = 0; b < 2; b++) {
            const auto passed_here = [&](const Gap *g) { return passed(g, b); };
            const auto turned = [&](const Gap *g) { return passing(g, b); };
            const auto cut_here = [&](const Gap *g) { return cut(g, b); };
            double low = 0.0, high = 1.0;
            bool looked = passed(end, b) > 0.0;
            if (looked && switched[b] && passing(gaps, b) < 0.0) {
                // A step that starts at an event first moves away from it.
                low = zero(dense, turned, 0.0, 1.0);
            } else if (!looked && may_touch_between(end, b, dense.length)) {
                double a = 0.0, c = 1.0;
                for (int i = 0; i < 40; i++) {
                    const double x = 0.5 * (a + c);
                    dense.at(x, y);
                    gaps_of(y, there);
                    (passing(there, b) > 0.0 ? a : c) = x;
                }
                high = a;
                dense.at(high, y);
                gaps_of(y, there);
                looked = passed(there, b) > 0.0;
            }
            if (looked) {
                const double x = zero(dense, passed_here, low, high);
                dense.at(x, y);
                gaps_of(y, there);
                if (passing(there, b) > 0.0 && x < first)
                    first = x, whose = b, which = BEGIN_OR_END;
            }
            if (cut(end, b) > 0.0 && !(switched[b] && cut(gaps, b) >= 0.0)) {
                const double x = zero(dense, cut_here, 0.0, 1.0);
                if (x < first) first = x, whose = b, which = CUT_OR_NOT;
            }
        }
        return first;
    }

    // Opens or closes a contact at a state with these gaps; returns whether it closed.
    bool change(int b, const Gap *there, Result &result) {
        switched[b] = true;
        if (phase[b] != OPEN) {
            phase[b] = OPEN;
            return false;
        }
        phase[b] = CLOSED;
        entry_speed[b] = std::max(there[b].rate, LEAST_SPEED);
        if (!result.onsets++) result.first_onset = time, result.first_speed = entry_speed[b];
        return true;
    }

    // Changes the contacts at an event; the other base may change at the same instant. Returns
    // whether one closed.
    bool happen(int whose, Event which, const Gap *there, Result &result) {
        bool closed = false;
        if (which == BEGIN_OR_END)
            closed = change(whose, there, result);
        else
            phase[whose] = phase[whose] == CLOSED ? CUT : CLOSED, switched[whose] = true;
        const int other = 1 - whose;
        const bool begins =
            phase[other] == OPEN && there[other].depth > -1e-15 && there[other].rate > 0.0;
        const bool ends =
            phase[other] != OPEN && there[other].depth < 1e-15 && there[other].rate < 0.0;
        if (begins || ends) closed |= change(other, there, result);
        return closed;
    }
};

// ---- runs, side by side

template <class Real> class Runs {
    static constexpr int WIDTH = sizeof(Real) / sizeof(double);
    const std::vector<double> &clearances;
    const double span, rtol, atol;
    Contacts<Real> contacts;
    Step<Real> step;
    Run runs[WIDTH];
    size_t next = 0;
    int active = 0;

  public:
    std::vector<Result> results;

    Runs(const std::vector<double> &clearances, double span, double rtol)
        : clearances(clearances), span(span), rtol(rtol), atol(1e-3 * rtol),
          results(clearances.size()) {}

    void go() {
        for (int k = 0; k < WIDTH; k++) begin(k);
        right_hand_side(contacts, step.before, step.k[0]);
        while (active > 0) {
            for (int k = 0; k < WIDTH; k++) choose_length(k);
            step.take(contacts);
            const Real error = step.error(rtol, atol);
            normalise(step.after);
            const Rotation<Real> r = rotation(step.after);
            const Base<Real> ends[2] = {
                base(contacts, 0, step.after, r), base(contacts, 1, step.after, r)};
            bool renew = false;  // the right-hand side at the start of the next step
            for (int k = 0; k < WIDTH; k++) {
                if (runs[k].number < 0) continue;
                const Gap end[2] = {{lane(ends[0].depth, k), lane(ends[0].rate, k)},
                    {lane(ends[1].depth, k), lane(ends[1].rate, k)}};
                renew |= finish(k, lane(error, k), end);
            }
            if (renew) right_hand_side(contacts, step.before, step.k[0]);
        }
    }

  private:
    // Puts the next run, or none, where number k was.
    void begin(int k) {
        Run &run = runs[k];
        active -= run.number >= 0;
        run = Run();
        if (next < clearances.size()) {
            run.number = int(next);
            run.clearance = clearances[next++];
            run.stiff = stiffness(run.clearance);
            active++;
        }
        for (Gap &gap : run.gaps) gap = {-run.clearance, 0.0};
        for (int i = 0; i < SIZE; i++) set_lane(step.before[i], k, i == 3 || i == 7 ? 1.0 : 0.0);
        set_lane(step.length, k, FIRST);
        share_contacts(k);
    }

    void share_contacts(int k) {
        const Run &run = runs[k];
        set_lane(contacts.clearance, k, run.clearance);
        for (int b = 0; b < 2; b++) {
            set_lane(contacts.stiffness[b], k, run.phase[b] == CLOSED ? run.stiff : 0.0);
            set_lane(contacts.damping[b], k, run.factor(b));
        }
        contacts.any = run.phase[0] != OPEN || run.phase[1] != OPEN;
    }

    void choose_length(int k) {
        Run &run = runs[k];
        double length = std::min(lane(step.length, k), LONGEST);
        run.last = run.time + length >= span;
        if (run.last) length = span - run.time;
        set_lane(step.length, k, run.number < 0 ? FIRST : length);
    }

    // Accepts or rejects the step of run k, and chooses its next. Returns whether the right-hand
    // side at the start of the next step has to be computed.
    bool finish(int k, double error, const Gap *end) {
        Run &run = runs[k];
        Result &result = results[run.number];
        const double length = lane(step.length, k),
                     grow = 0.9 * std::pow(std::max(error, 1e-12), -0.2);
        if (!(error <= 1.0)) {
            result.rejected++;
            run.rejected = true;
            set_lane(step.length, k, length * std::min(std::max(grow, 0.2), 0.9));
            return false;
        }
        result.accepted++;
        const bool touching = run.phase[0] != OPEN || run.phase[1] != OPEN;
        const double proposed = length * std::min(grow, run.rejected ? 1.0 : 5.0);
        int whose = 0;
        Event which = BEGIN_OR_END;
        double share = 2.0, landed[SIZE];
        if (run.eventful(end, length)) {
            const Dense dense(step, k);
            share = run.first_event(dense, end, whose, which);
            if (share <= 1.0) dense.at(share, landed);
        }
        const bool happens = share <= 1.0;
        if (happens) run.last = false;
        const double taken = happens ? share * length : length;
        run.time = run.last ? span : run.time + taken;
        if (run.begins_contact && !happens) run.step_at_onset = taken;
        run.begins_contact = run.rejected = run.switched[0] = run.switched[1] = false;
        if (happens) {
            Gap there[2];
            run.gaps_of(landed, there);
            const bool closed = run.happen(whose, which, there, result);
            const bool touches = run.phase[0] != OPEN || run.phase[1] != OPEN;
            if (!touching) run.step_in_flight = std::max(proposed, length);
            double following = std::max(length, taken);
            if (!touches) {
                following = run.step_in_flight;
            } else if (closed) {
                const double known = run.step_at_onset > 0.0 ? 1.5 * run.step_at_onset : ONSET;
                following = touching ? std::min(length, known) : known;
                run.begins_contact = true;
            }
            for (int i = 0; i < SIZE; i++) set_lane(step.before[i], k, landed[i]);
            share_contacts(k);
            run.gaps_of(landed, run.gaps);
            set_lane(step.length, k, following);
        } else {
            run.gaps[0] = end[0], run.gaps[1] = end[1];
            set_lane(step.length, k, proposed);
            for (int i = 0; i < SIZE; i++) {
                set_lane(step.before[i], k, lane(step.after[i], k));
                set_lane(step.k[0][i], k, lane(step.k[6][i], k));
            }
        }
        if (run.time < span) return happens;
        for (int i = 0; i < SIZE; i++) result.state[i] = lane(step.before[i], k);
        begin(k);
        return true;
    }
};

template <class Real>
void report(const std::vector<double> &clearances, double span, double rtol, int rounds) {
    double seconds = std::numeric_limits<double>::max();
    std::vector<Result> results;
    for (int round = 0; round < rounds; round++) {
        const auto runs = std::make_unique<Runs<Real>>(clearances, span, rtol);
        const std::clock_t start = std::clock();
        runs->go();
        seconds = std::min(seconds, double(std::clock() - start) / CLOCKS_PER_SEC);
        results = runs->results;
    }
    std::printf("{\"seconds\": %.9g, \"runs\": [", seconds);
    for (size_t k = 0; k < results.size(); k++) {
        const Result &run = results[k];
        const Rotation<double> r = rotation(run.state);
        std::printf("%s\n {\"accepted\": %ld, \"rejected\": %ld, \"onsets\": %ld, ", k ? "," : "",
            run.accepted, run.rejected, run.onsets);
        std::printf(run.onsets ? "\"first_onset\": %.17g, \"first_speed\": %.17g, "
                               : "\"first_onset\": null, \"first_speed\": null, ",
            run.first_onset, run.first_speed);
        std::printf("\"arm_2\": [%.17g, %.17g, %.17g]}", run.state[0] + HALF * r.first.x,
            run.state[1] + HALF * r.second.x, run.state[2] + HALF * r.third.x);
    }
    std::printf("]}\n");
}

int main(int count, char **words) {
    if (count != 8) {
        std::fprintf(stderr, "usage: %s WIDTH SPAN RTOL RUNS LEAST MOST ROUNDS\n", words[0]);
        return 2;
    }
    const double span = std::atof(words[2]), rtol = std::atof(words[3]);
    const int width = std::atoi(words[1]), runs = std::atoi(words[4]), rounds = std::atoi(words[7]);
    const double least = std::atof(words[5]), most = std::atof(words[6]);
    if ((width != 1 && width != 8) || runs < 1 || rounds < 1 || !(span > 0.0) || !(rtol > 0.0) ||
        !(least > 0.0) || !(most < RADIUS)) {
        std::fprintf(stderr,
            "WIDTH must be 1 or 8, RUNS and ROUNDS at least 1, SPAN and RTOL positive, and "
            "clearances positive and below %g m\n",
            RADIUS);
        return 2;
    }
    std::vector<double> clearances;
    for (int k = 0; k < runs; k++)
        clearances.push_back(least * std::pow(most / least, runs > 1 ? k / (runs - 1.0) : 0.0));
    if (width == 8)
        report<Eight>(clearances, span, rtol, rounds);
    else
        report<double>(clearances, span, rtol, rounds);
}
