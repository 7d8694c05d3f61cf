"""The compiled kernels. Importing this module compiles them or loads them from the cache.

Every kernel has explicit signatures, so that no call ever compiles; the callers in this package bring their
arguments to the dtype, layout and writability named there. Kernels are serial, release the GIL and hold no
state, so that any number of threads can run them. All kernels and their helpers live in this one file: the
cache is invalidated by a change of the file that a kernel is in, not by a change of a helper elsewhere.

`fastmath` here allows the compiler to reorder sums and fuse multiply-adds, without which loops do not
vectorise. It keeps infinities and NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import overload

FAST = {"reassoc", "contract", "nsz", "arcp"}

f4, f8, i2, i8 = types.float32, types.float64, types.int16, types.int64
u1, u8 = types.uint8, types.uint64


def _in(dtype: types.Type, ndim: int) -> types.Array:
    """A C-contiguous array that the kernel reads."""
    return types.Array(dtype, ndim, "C", readonly=True)


def _out(dtype: types.Type, ndim: int) -> types.Array:
    """A C-contiguous array that the kernel may write."""
    return types.Array(dtype, ndim, "C")


def kernel(*signatures: Any, fastmath: Any = False) -> Callable[[Callable], Any]:
    """Compile for the given signatures, with the disk cache where there is one that works."""

    def compile_now(function: Callable) -> Any:
        options = {"nogil": True, "fastmath": fastmath, "error_model": "numpy"}
        try:
            return njit(list(signatures), cache=True, **options)(function)
        except Exception:  # no writable folder, a full disk, a damaged cache; a real error comes again below
            return njit(list(signatures), **options)(function)

    return compile_now


# --- exp2 ---------------------------------------------------------------------------------------------------

# Minimax polynomials of 2**x on [-1, 0], exactly 1 at 0: relative error 8.4e-8 and 2.3e-16.
_P32 = tuple(
    np.float32(c)
    for c in (
        1.0,
        0.6931437211502668,
        0.2401801428965228,
        0.05529735828672878,
        0.009205798220737976,
        0.0009449036751463187,
    )
)
_P64 = (
    1.0,
    0.6931471805599128,
    0.24022650695758693,
    0.055504108640248385,
    0.009618128908763917,
    0.0013333548843664574,
    0.00015403259660838408,
    1.5247664350553868e-05,
    1.3154154874163558e-06,
    9.711490477316355e-08,
    4.98533637176433e-09,
)
# Powers whose exponent bits, added to those of 1.0, give exactly zero.
_ZERO32 = np.float32(-127.0)
_ZERO64 = -1023.0


def _exp2(t: float) -> float:
    """``2**t`` for t <= 0, in the precision of t; anything below the normal numbers counts as the
    smallest."""
    raise NotImplementedError


@overload(_exp2, jit_options={"fastmath": FAST})
def _exp2_overload(t):
    """Split t = i + f with -1 < f <= 0, and add i to the exponent bits of a polynomial in f."""
    p0, p1, p2, p3, p4, p5 = _P32
    q0, q1, q2, q3, q4, q5, q6, q7, q8, q9, q10 = _P64

    def single(t):
        t = t if t > _ZERO32 else _ZERO32
        i = np.int32(t)
        f = t - np.float32(i)
        p = np.float32(p0 + f * (p1 + f * (p2 + f * (p3 + f * (p4 + f * p5)))))
        bits = np.int32(p.view(np.int32) + (i << np.int32(23)))
        return bits.view(np.float32)

    def double(t):
        t = t if t > _ZERO64 else _ZERO64
        i = np.int32(t)
        f = t - np.float64(i)
        high = f * (q7 + f * (q8 + f * (q9 + f * q10)))
        p = np.float64(q0 + f * (q1 + f * (q2 + f * (q3 + f * (q4 + f * (q5 + f * (q6 + high)))))))
        bits = np.int64(p.view(np.int64) + (np.int64(i) << np.int64(52)))
        return bits.view(np.float64)

    return {f4: single, f8: double}.get(t)


# --- history sampling
# -----------------------------------------------------------------------------------------

# Histories lie in LANES runs of equal length, side by side: column DEPTH * LANES * k + LANES * g + lane holds
# history (blocks * lane + k) * DEPTH + g. A vector register then sums LANES runs at once and needs no
# reduction.
LANES = 16
DEPTH = 8
BLOCK = LANES * DEPTH

CELL = 3.0  # the side of the cells that innovations are grouped by
_PER_CELL = 1.0 / CELL
_BUCKETS = 1024
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_U31 = np.uint64(31)
_PLAIN_RANGE = 60.0  # exponents may differ by so much without the largest being taken out of each row

helper = njit(fastmath=FAST, error_model="numpy")


@helper
def _term(base, x, y, a, b, peak):
    return _exp2(base + (x * a + y * b) - peak)


@helper
def _sum_row(base, slopes, v, peak, sums, lanes):
    """Sum of 2**(base_l + slopes_l v - peak) over the first two coordinates; its parts by lane and block, and
    by lane."""
    x, y = slopes[0], slopes[1]
    a, b = v[0], v[1]
    blocks = len(base) // BLOCK
    for k in range(blocks):
        w = base[k * BLOCK : (k + 1) * BLOCK]
        p = x[k * BLOCK : (k + 1) * BLOCK]
        q = y[k * BLOCK : (k + 1) * BLOCK]
        s = sums[k * LANES : (k + 1) * LANES]
        for l in range(LANES):
            i1, i2, i3 = l + LANES, l + 2 * LANES, l + 3 * LANES
            i4, i5, i6, i7 = l + 4 * LANES, l + 5 * LANES, l + 6 * LANES, l + 7 * LANES
            s[l] = (
                (_term(w[l], p[l], q[l], a, b, peak) + _term(w[i1], p[i1], q[i1], a, b, peak))
                + (_term(w[i2], p[i2], q[i2], a, b, peak) + _term(w[i3], p[i3], q[i3], a, b, peak))
            ) + (
                (_term(w[i4], p[i4], q[i4], a, b, peak) + _term(w[i5], p[i5], q[i5], a, b, peak))
                + (_term(w[i6], p[i6], q[i6], a, b, peak) + _term(w[i7], p[i7], q[i7], a, b, peak))
            )
    lanes[:] = 0.0
    for k in range(blocks):
        s = sums[k * LANES : (k + 1) * LANES]
        for l in range(LANES):
            lanes[l] += s[l]
    total = 0.0
    for l in range(LANES):
        total += lanes[l]
    return total


@helper
def _draw(base, slopes, v, peak, sums, lanes, target):
    """The first history at which the running sum exceeds ``target``: find its lane, its block, then its
    place.

    Where rounding leaves the running sum below the target, the last of what is positive. -1 if nothing is.
    """
    below = 0.0
    lane = -1
    for l in range(LANES):
        if lanes[l] > 0.0:
            below += lanes[lane] if lane >= 0 else 0.0
            lane = l
            if below + lanes[l] > target:
                break
    block = -1
    blocks = len(base) // BLOCK
    for k in range(blocks):
        part = sums[k * LANES + lane]
        if part > 0.0:
            below += sums[block * LANES + lane] if block >= 0 else 0.0
            block = k
            if below + part > target:
                break
    found = -1
    for g in range(DEPTH):
        i = (block * DEPTH + g) * LANES + lane
        term = _term(base[i], slopes[0, i], slopes[1, i], v[0], v[1], peak)
        if term > 0.0:
            found = (blocks * lane + block) * DEPTH + g
            below += term
            if below > target:
                break
    return found


@helper
def _peak(base, slopes, v, lanes):
    """The largest base_l + slopes_l v over the first two coordinates."""
    x, y = slopes[0], slopes[1]
    a, b = v[0], v[1]
    lanes[:] = -np.inf
    for k in range(0, len(base), LANES):
        w = base[k : k + LANES]
        p = x[k : k + LANES]
        q = y[k : k + LANES]
        for l in range(LANES):
            t = w[l] + (p[l] * a + q[l] * b)
            lanes[l] = t if t > lanes[l] else lanes[l]
    return lanes.max()


@helper
def _fold(base, slopes, v, folded):
    """``base`` plus slopes times ``v`` in the third and further coordinates."""
    folded[:] = base
    for j in range(2, len(v)):
        x, a = slopes[j], v[j]
        for l in range(len(base)):
            folded[l] += x[l] * a


@kernel(types.int64(_in(f8, 2), _out(i8, 1), _out(i8, 1)))
def group_rows(innovations, order, starts):
    """Put ``innovations (d, M)`` of one cell side by side: ``order[starts[k]:starts[k + 1]]`` is a group; returns how
    many there are.

    ``starts`` has M + 1 places. By chance a cell's rows may end up in several groups.
    """
    d, rows = innovations.shape
    bucket = np.empty(rows, dtype=np.int64)
    ends = np.zeros(_BUCKETS + 1, dtype=np.int64)
    for i in range(rows):
        mixed = np.uint64(0)
        for j in range(d):
            cell = np.rint(innovations[j, i] * _PER_CELL)
            cell = cell if abs(cell) < 1e15 else 0.0
            mixed = (mixed ^ np.uint64(np.int64(cell))) * _MIX1
            mixed ^= mixed >> _U31
        bucket[i] = np.int64(mixed % np.uint64(_BUCKETS))
        ends[bucket[i] + 1] += 1
    for b in range(_BUCKETS):
        ends[b + 1] += ends[b]
    for i in range(rows):
        order[ends[bucket[i]]] = i
        ends[bucket[i]] += 1
    groups = 0
    for i in range(rows):
        same = i > 0
        for j in range(d):
            here, before = innovations[j, order[i]], innovations[j, order[i - 1]]
            same = same and np.rint(here * _PER_CELL) == np.rint(before * _PER_CELL)
        if not same:
            starts[groups] = i
            groups += 1
    starts[groups] = rows
    return groups


@helper
def _largest(values, lanes):
    """The largest of ``values (L,)``, in lanes, because a plain loop is not vectorised."""
    whole = len(values) // LANES * LANES
    lanes[:] = -np.inf
    for k in range(0, whole, LANES):
        part = values[k : k + LANES]
        for l in range(LANES):
            lanes[l] = part[l] if part[l] > lanes[l] else lanes[l]
    for i in range(whole, len(values)):
        lanes[0] = values[i] if values[i] > lanes[0] else lanes[0]
    return lanes.max()


@helper
def _bound(z, base, centre, upper, lower):
    """Fill bounds of base_l - |z_l - u|^2 for all u in the cell about ``centre``.

    With u = c + v the square is |z - c|^2 - 2 (z - c) v + |v|^2, and no component of v is larger than half a side.
    """
    x, y = z[0], z[1]
    a, b = centre[0], centre[1]
    for l in range(len(base)):
        p, q = x[l] - a, y[l] - b
        level, slack = base[l] - (p * p + q * q), CELL * (abs(p) + abs(q))
        upper[l] = level + slack
        lower[l] = level - slack
    for j in range(2, len(centre)):
        x, a = z[j], centre[j]
        for l in range(len(base)):
            p = x[l] - a
            upper[l] += CELL * abs(p) - p * p
            lower[l] -= CELL * abs(p) + p * p


@helper
def _keep(upper, lowest, kept):
    """Fill ``kept`` with the histories whose bound is not below ``lowest``, in order; returns how many there are."""
    count = 0
    for l in range(len(upper)):
        kept[count] = l
        count += upper[l] >= lowest
    return count


@helper
def _expand(z, base, centre, highest, kept, near):
    """The square expanded about the cell's centre: exponents are ``highest + near[-1] + near[:-1] . v - |v|^2``.

    ``near`` is in lane order; columns beyond those of ``kept`` are filled with nothing. Returns how far wrong single
    precision can make the exponents: a bound, in units of 2**-24.
    """
    d, count = len(centre), len(kept)
    exponents = near[-1]
    run = len(exponents) // LANES
    largest, farthest = 0.0, 0.0
    for lane in range(LANES):
        for step in range(run):
            i = step * LANES + lane
            if lane * run + step >= count:
                near[:, i] = 0.0
                exponents[i] = -np.inf
                continue
            l = kept[lane * run + step]
            squares = 0.0
            for j in range(d):
                away = z[j, l] - centre[j]
                near[j, i] = 2.0 * away
                squares += away * away
            exponents[i] = base[l] - squares - highest
            largest = max(largest, abs(exponents[i]))
            farthest = max(farthest, squares)
    return 2.0 * largest + 10.0 * math.sqrt(farthest) * 0.5 * CELL * math.sqrt(d)


@helper
def _sample_group(near, far, highest, centre, kept, rows, innovations, uniforms, work, lanes, logs, ancestors):
    """``sample_groups`` for the ``rows`` of one group, in the precision of ``near``; see ``_expand``."""
    slopes, exponents = near[:-1], near[-1]
    length = len(exponents)
    sums, folded = work[: length // DEPTH], work[length // DEPTH :][:length]
    largest, v = np.empty(LANES, dtype=near.dtype), np.zeros(len(slopes), dtype=near.dtype)
    base = exponents if len(slopes) == 2 else folded
    for i in rows:
        squares = 0.0
        for j in range(len(centre)):
            away = innovations[j, i] - centre[j]
            v[j] = away
            squares += away * away
        if len(slopes) > 2:
            _fold(exponents, slopes, v, base)
        largest[0] = 0.0
        peak = _peak(base, slopes, v, largest) if far else largest[0]
        total = _sum_row(base, slopes, v, peak, sums, lanes)
        logs[i] = np.log2(total) + (peak - squares + highest)
        if len(uniforms) > 0:
            found = _draw(base, slopes, v, peak, sums, lanes, uniforms[i] * total) if total > 0.0 else -1
            ancestors[i] = kept[found] if found >= 0 else -1


def _groups_signature() -> Any:
    histories = (_in(f8, 2), _in(f8, 1))
    groups = (_in(i8, 1), _in(i8, 1))
    return types.void(*histories, _in(f8, 2), _in(f8, 1), *groups, f8, f8, _out(f8, 1), _out(i8, 1))


@kernel(_groups_signature(), fastmath=FAST)
def sample_groups(z, base, innovations, uniforms, order, starts, cutoff, tolerance, logs, ancestors):
    """For each innovation u the sum over l of 2**(base_l - |z_l - u|^2), and a draw with these odds.

    For the innovations of one cell, histories whose terms are nowhere in it within 2**-cutoff of the largest are left
    out, and coordinates are relative to its centre. A row does not depend on what other rows there are.

    Args:
        z: ``(d, L)``, d >= 2.
        base: ``(L,)``.
        innovations: ``(d, M)``.
        uniforms: ``(M,)``, or empty for no draws.
        order, starts: of the groups; see ``group_rows``.
        cutoff: positive.
        tolerance: how far wrong an exponent may be for single precision, in units of 2**-24.
        logs: ``(M,)``, the base-2 logarithms of the sums; minus infinity where a row is lost.
        ancestors: ``(M,)``, the draws; -1 where a row is lost.
    """
    d, count = z.shape
    room = (d + 1) * (count + BLOCK)
    single, double = np.empty(room, dtype=np.float32), np.empty(room)
    upper, lower = np.empty(count), np.empty(count)
    kept, lanes, centre = np.empty(count + 1, dtype=np.int64), np.empty(LANES), np.empty(d)
    work32, work64 = np.empty(2 * (count + BLOCK), dtype=np.float32), np.empty(2 * (count + BLOCK))
    for k in range(len(starts) - 1):
        rows = order[starts[k] : starts[k + 1]]
        for j in range(d):
            centre[j] = np.rint(innovations[j, rows[0]] * _PER_CELL) * CELL
        _bound(z, base, centre, upper, lower)
        largest_square = 0.25 * CELL * CELL * len(centre)
        lowest, highest = _largest(lower, lanes) - largest_square, _largest(upper, lanes)
        if not lowest > -np.inf:
            for i in rows:
                logs[i], ancestors[i] = -np.inf, -1
            continue
        remaining = _keep(upper, lowest - cutoff, kept)
        far = highest - lowest > _PLAIN_RANGE
        length = (remaining + BLOCK - 1) // BLOCK * BLOCK
        size = (d + 1) * length
        near = double[:size].reshape(d + 1, length)
        error = _expand(z, base, centre, highest, kept[:remaining], near)
        if error <= tolerance:
            single[:size] = double[:size]
            near32 = single[:size].reshape(d + 1, length)
            _sample_group(
                near32, far, highest, centre, kept, rows, innovations, uniforms, work32, lanes, logs, ancestors
            )
        else:
            _sample_group(near, far, highest, centre, kept, rows, innovations, uniforms, work64, lanes, logs, ancestors)


# --- contour scan
# ---------------------------------------------------------------------------------------------

FRACTION_BITS = 32  # of the fixed-point positions; a pixel's index is what is left of them


@njit(error_model="numpy")
def _place_normals(transform, points, normals, shift, placed):
    """Fill ``placed (4, L)`` with x, y and the unit normal, up to its sign, of each contour point.

    False if the transform is singular or not finite.
    """
    a, b, c = transform[0, 0], transform[0, 1], transform[0, 2]
    d, e, f = transform[1, 0], transform[1, 1], transform[1, 2]
    xs, ys, ps, qs = placed[0], placed[1], placed[2], placed[3]
    px, py, mx, my = points[0], points[1], normals[0], normals[1]
    count = 0
    for l in range(len(px)):
        x = (a * px[l] + b * py[l] + c) + shift
        y = (d * px[l] + e * py[l] + f) + shift
        p = e * mx[l] - d * my[l]
        q = a * my[l] - b * mx[l]
        length = math.sqrt(p * p + q * q)
        count += (abs(x) < np.inf) & (abs(y) < np.inf) & (length > 0.0) & (length < np.inf)
        xs[l], ys[l], ps[l], qs[l] = x, y, p / length, q / length
    return count == len(px) and abs(a * e - b * d) > 0.0


@kernel(types.void(_in(u1, 2), i8, _in(f8, 3), _in(f8, 2), _in(f8, 2), _in(f8, 1), _out(f8, 1)))
def scan_contours(padded, margin, transforms, points, normals, cost, log_likelihood):
    """The summed cost of each transform; ``pfviz.kernels.contours`` says of what, and does it in the same
    order.

    ``points`` and ``normals`` are ``(2, L)`` here.
    """
    reach = len(cost) - 2
    height, width = padded.shape
    pixels = padded.reshape(width * height)
    lowest = margin - reach - 0.5
    right, bottom = width - lowest, height - lowest
    bits = np.int64(FRACTION_BITS)
    one = 2.0**FRACTION_BITS
    placed = np.empty((4, points.shape[1]))
    for n in range(len(transforms)):
        if not _place_normals(transforms[n], points, normals, margin + 0.5, placed):
            log_likelihood[n] = -np.inf
            continue
        total = 0.0
        for l in range(points.shape[1]):
            x, y = placed[0, l], placed[1, l]
            found = reach + 1
            if lowest <= x <= right and lowest <= y <= bottom:
                x, y = np.int64(x * one), np.int64(y * one)
                p, q = np.int64(placed[2, l] * one), np.int64(placed[3, l] * one)
                found = 0
                while found <= reach:
                    ahead = ((y + found * q) >> bits) * width + ((x + found * p) >> bits)
                    behind = ((y - found * q) >> bits) * width + ((x - found * p) >> bits)
                    if pixels[np.uint64(ahead)] | pixels[np.uint64(behind)]:
                        break
                    found += 1
            total += cost[found]
        log_likelihood[n] = total


# --- gradients
# ------------------------------------------------------------------------------------------------------------


@kernel(types.void(_in(i2, 3), _in(i2, 3), _out(i2, 2), _out(i2, 2)))
def steepest(dx, dy, across, down):
    """Of two channels the gradient that is longer; of equal ones, the first."""
    height, width = across.shape
    for r in range(height):
        p, q = dx[r].reshape(2 * width), dy[r].reshape(2 * width)
        to_p, to_q = across[r], down[r]
        for c in range(width):
            p0, p1 = np.int32(p[2 * c]), np.int32(p[2 * c + 1])
            q0, q1 = np.int32(q[2 * c]), np.int32(q[2 * c + 1])
            second = np.uint32(p1 * p1 + q1 * q1) > np.uint32(p0 * p0 + q0 * q0)
            to_p[c] = p1 if second else p0
            to_q[c] = q1 if second else q0


# --- regions of an image
# ------------------------------------------------------------------------------------------------------

PARTICLES_ABREAST = 32


@njit(error_model="numpy")
def _pixel(transform, x, y, width, height):
    """The index of the pixel that a point is put into; one of the border for what is outside or not finite."""
    u = transform[0, 0] * x + transform[0, 1] * y + transform[0, 2]
    v = transform[1, 0] * x + transform[1, 1] * y + transform[1, 2]
    u = u if u > 0.0 else 0.0
    v = v if v > 0.0 else 0.0
    u = u if u < width - 1.0 else width - 1.0
    v = v if v < height - 1.0 else height - 1.0
    return np.uint64(np.int64(v) * width + np.int64(u))


@njit(error_model="numpy")
def _pixels_abreast(t, x, y, width, height, found):
    """Fill ``found`` with the ``_pixel`` of one point for several particles with the transforms ``t (6, ...)``."""
    a, b, c, d, e, f = t[0], t[1], t[2], t[3], t[4], t[5]
    for i in range(PARTICLES_ABREAST):
        u = a[i] * x + b[i] * y + c[i]
        v = d[i] * x + e[i] * y + f[i]
        u = u if u > 0.0 else 0.0
        v = v if v > 0.0 else 0.0
        u = u if u < width - 1.0 else width - 1.0
        v = v if v < height - 1.0 else height - 1.0
        found[i] = np.int64(v) * width + np.int64(u)


@kernel(types.void(_in(u1, 2), _in(f8, 3), _in(f8, 2), _in(f8, 1), _out(f8, 1)))
def weighted_sums(image, transforms, points, weights, sums):
    """For each transform the sum of the pixels under ``points (M, 2)``, each times its weight.

    Several particles abreast: each one's sum is taken in the order of the points, and none waits for another.
    """
    height, width = image.shape
    pixels = image.reshape(width * height)
    count = len(transforms)
    t, found = np.zeros((6, PARTICLES_ABREAST)), np.empty(PARTICLES_ABREAST, dtype=np.int64)
    totals = np.empty(PARTICLES_ABREAST)
    for start in range(0, count, PARTICLES_ABREAST):
        abreast = min(PARTICLES_ABREAST, count - start)
        for i in range(abreast):
            for k in range(6):
                t[k, i] = transforms[start + i, k // 3, k % 3]
        totals[:] = 0.0
        for j in range(len(points)):
            _pixels_abreast(t, points[j, 0], points[j, 1], width, height, found)
            for i in range(PARTICLES_ABREAST):
                totals[i] += weights[j] * pixels[np.uint64(found[i])]
        for i in range(abreast):
            sums[start + i] = totals[i]


@kernel(types.void(_in(u1, 2), _in(f8, 3), _in(f8, 2), _in(i8, 1), _in(f8, 2), _out(f8, 1)), fastmath=FAST)
def region_affinities(bins, transforms, points, starts, roots, affinities):
    """For each transform the mean Bhattacharyya coefficient of the regions; see ``pfviz.kernels.regions``."""
    height, width = bins.shape
    pixels = bins.reshape(width * height)
    regions, count = roots.shape
    histogram = np.empty(256)
    for n in range(len(transforms)):
        transform = transforms[n]
        total = 0.0
        for r in range(regions):
            histogram[:] = 0.0
            for j in range(starts[r], starts[r + 1]):
                histogram[pixels[_pixel(transform, points[j, 0], points[j, 1], width, height)]] += 1.0
            affinity = 0.0
            for b in range(count):
                affinity += roots[r, b] * math.sqrt(histogram[b])
            total += affinity / math.sqrt(starts[r + 1] - starts[r])
        affinities[n] = total / regions


@kernel(types.void(_in(u1, 2), _in(f8, 3), _in(f8, 2), _in(f8, 1), _out(f8, 1)))
def patch_correlations(image, transforms, points, template, correlations):
    """For each transform the correlation of the pixels under ``points (M, 2)`` with ``template (M,)``."""
    height, width = image.shape
    pixels = image.reshape(width * height)
    count = len(points)
    for n in range(len(transforms)):
        transform = transforms[n]
        total = 0.0
        squares = 0.0
        product = 0.0
        for j in range(count):
            value = np.float64(pixels[_pixel(transform, points[j, 0], points[j, 1], width, height)])
            total += value
            squares += value * value
            product += value * template[j]
        variance = squares - total * total / count
        correlations[n] = product / math.sqrt(variance) if variance > 0.5 else 0.0


# --- propagation
# ----------------------------------------------------------------------------------------------

NORMALS_BLOCK = 256

_WEYL = np.uint64(0x9E3779B97F4A7C15)
_MIX2 = np.uint64(0x94D049BB133111EB)
_MIX3 = np.uint64(0xD6E8FEB86659FD93)
_ONE = np.uint64(0x3FF0000000000000)
_SQRT_HALF = np.int64(0x3FE6A09E667F3BCD)
_MANTISSA = np.int64(0x000FFFFFFFFFFFFF)
_U1, _U12, _U27, _U30, _U32 = (np.uint64(v) for v in (1, 12, 27, 30, 32))

# Chebyshev interpolants, relative error below 1e-12: log((1+s)/(1-s)) = s * L(s^2) for |s| <= (sqrt 2 -
# 1)/(sqrt 2 + 1), cos(2 pi w) = C(w^2) and sin(2 pi w) = w * S(w^2) for |w| <= 1/4.
_L0, _L1, _L2, _L3, _L4, _L5 = (
    1.9999999999999472,
    0.6666666667957926,
    0.3999999489183238,
    0.28572166145875727,
    0.2217424991007749,
    0.19608095639753054,
)
_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7 = (
    0.9999999999999981,
    -19.739208802174744,
    64.93939402133272,
    -85.45681703563287,
    60.24463060817376,
    -26.42588874334368,
    7.896555735851554,
    -1.6452233497893094,
)
_S0, _S1, _S2, _S3, _S4, _S5, _S6 = (
    6.28318530717927,
    -41.341702239903675,
    81.60524914901583,
    -76.70584754377326,
    42.058134871372054,
    -15.081483206893,
    3.6658551595639612,
)


@helper
def _random_bits(counter, key0, key1):
    h = key0 + counter * _WEYL
    h = (h ^ (h >> _U30)) * _MIX1
    h = (h ^ (h >> _U27)) * _MIX2
    h = ((h ^ (h >> _U31)) ^ key1) * _MIX3
    return h ^ (h >> _U32)


@helper
def _radius(bits):
    """sqrt(-2 log u) of the uniform ((bits >> 12) + 1/2) * 2**-52."""
    mantissa = np.uint64((bits >> _U12) | _ONE)
    uniform = np.float64(mantissa.view(np.float64) - (1.0 - 2.0**-53))
    shifted = np.int64(uniform.view(np.int64) - _SQRT_HALF)
    exponent = np.float64(np.int32(shifted >> np.int64(52)))
    reduced = np.int64((shifted & _MANTISSA) + _SQRT_HALF)
    m = reduced.view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    v = s * s
    log_m = s * (_L0 + v * (_L1 + v * (_L2 + v * (_L3 + v * (_L4 + v * _L5)))))
    return math.sqrt(-2.0 * (exponent * 0.6931471805599453 + log_m))


@helper
def _fill_normals(first, key0, key1, normals):
    """Box-Muller: pairs ``first``, ``first + 1``, ... of the stream, cosines in the first half and sines in
    the second."""
    half = len(normals) // 2
    cosines, sines = normals[:half], normals[half:]
    for t in range(half):
        counter = (first + np.uint64(t)) << _U1
        radius = _radius(_random_bits(counter, key0, key1))
        bits = _random_bits(counter | _U1, key0, key1)
        mantissa = np.uint64((bits >> _U12) | _ONE)
        w = 0.5 * (mantissa.view(np.float64) - 1.5)
        v = w * w
        high = v * (_C4 + v * (_C5 + v * (_C6 + v * _C7)))
        cosine = _C0 + v * (_C1 + v * (_C2 + v * (_C3 + high)))
        high = v * (_S3 + v * (_S4 + v * (_S5 + v * _S6)))
        sine = w * (_S0 + v * (_S1 + v * (_S2 + high)))
        cosines[t] = radius * cosine if bits & _U1 else -(radius * cosine)
        sines[t] = radius * sine


@helper
def _add_scaled(scale, values, sums):
    for i in range(len(sums)):
        sums[i] += scale * values[i]


@kernel(
    types.void(_in(f8, 2), _in(i8, 1), _in(f8, 2), _in(f8, 1), _in(f8, 2), u8, u8, _out(f8, 2)),
    fastmath=FAST,
)
def propagate(states, ancestors, coefficients, offset, factor, key0, key1, result):
    """``result[i] = (offset + coefficients @ x + factor @ z, x[:-k])`` with x = states[ancestors[i]].

    Args:
        states: ``(N, p * k)``, newest block first.
        ancestors: ``(N,)``, or empty for everyone its own.
        coefficients: ``(k, p * k)``.
        offset: ``(k,)``.
        factor: ``(k, k)``, of the noise covariance.
        key0, key1: of the random stream.
        result: ``(N, p * k)``, filled.
    """
    n, width = result.shape
    k = len(offset)
    old, new = states.reshape(states.size), result.reshape(result.size)
    normals = np.empty((k, NORMALS_BLOCK))
    rows = np.empty((k + width, NORMALS_BLOCK))  # the new block of each particle, then its parent's blocks
    place = np.empty(NORMALS_BLOCK, dtype=np.uint64)
    for block in range((n + NORMALS_BLOCK - 1) // NORMALS_BLOCK):
        start = block * NORMALS_BLOCK
        count = min(NORMALS_BLOCK, n - start)
        for c in range(k):
            _fill_normals(np.uint64((block * k + c) * (NORMALS_BLOCK // 2)), key0, key1, normals[c])
        for i in range(count):
            parent = ancestors[start + i] if len(ancestors) > 0 else start + i
            place[i] = np.uint64(parent * width)
        for j in range(width):
            row = rows[k + j]
            for i in range(count):
                row[i] = old[place[i] + np.uint64(j)]
        for c in range(k):
            rows[c, :] = offset[c]
            for j in range(width):
                _add_scaled(coefficients[c, j], rows[k + j], rows[c])
            for j in range(k):
                _add_scaled(factor[c, j], normals[j], rows[c])
        for j in range(width):
            row, to = rows[j], np.uint64(start * width + j)
            for i in range(count):
                new[to] = row[i]
                to += np.uint64(width)


# --- weights
# --------------------------------------------------------------------------------------------------


@kernel(types.boolean(_in(f8, 1), f8, _out(i8, 1)), fastmath=FAST)
def systematic_ancestors(weights, offset, ancestors):
    """Fill ``ancestors``; False if a weight is negative, or M divided by their sum is not a positive number.

    Each particle marks the first of the points m + offset in its share; then everyone takes the last mark. A
    particle without a point is overwritten by the next one with any. Nothing after the last positive weight
    marks.
    """
    total = 0.0
    negative = 0
    for i in range(len(weights)):
        total += weights[i]
        negative += weights[i] < 0.0
    scale = len(ancestors) / total
    if negative > 0 or not 0.0 < scale < np.inf:
        return False
    last = len(weights) - 1
    while weights[last] == 0.0:
        last -= 1
    ancestors[:] = 0
    cumulative = 0.0
    for i in range(last + 1):
        first = np.int64(np.ceil(cumulative * scale - offset))
        if first < len(ancestors):
            ancestors[np.uint64(first)] = i
        cumulative += weights[i]
    newest = 0
    for m in range(len(ancestors)):
        newest = max(newest, ancestors[m])
        ancestors[m] = newest
    return True


@kernel(types.UniTuple(f8, 2)(_in(f8, 1), f8, _out(f8, 1), _out(f8, 1)), fastmath=FAST)
def normalise_log_weights(log_weights, peak, normalised, weights):
    """Fills ``normalised`` and ``weights``; returns the log of the sum and the effective sample size.

    The sums have a loop without writing: one that writes is vectorised only where the arrays lie far enough apart in
    memory, and the order of a sum, with it the last digit, would depend on where a few particles happen to lie.
    """
    total = 0.0
    squares = 0.0
    for i in range(len(log_weights)):
        weights[i] = _exp2((log_weights[i] - peak) * 1.4426950408889634)
    for i in range(len(weights)):
        total += weights[i]
        squares += weights[i] * weights[i]
    log_sum = peak + math.log(total)
    scale = 1.0 / total
    for i in range(len(log_weights)):
        weights[i] *= scale
        normalised[i] = log_weights[i] - log_sum
    return log_sum, total * total / squares
