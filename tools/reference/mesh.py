"""Section MESH, from spec/mesh.md."""

import math
import struct
from collections import deque

from entropy import Bit, Damaged, Number, Range

OPEN, BORDER, FILLED = range(3)


def to_single(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


class Gate:
    def __init__(self, start, end, half_edge):
        self.start, self.end, self.half_edge = start, end, half_edge
        self.state, self.previous, self.next = OPEN, None, None


def link(x, y):
    x.next, y.previous = y, x


class Connectivity:
    """Section 2. `triangles`, and `opposite`: half-edge (triangle, side) to half-edge."""

    def __init__(self, coder, vertices, triangles):
        self.coder, self.vertices, self.wanted = coder, vertices, triangles
        self.known, self.triangles, self.opposite = 0, [], {}
        self.degree, self.latest = [0] * vertices, [None] * vertices
        self.queue, self.urgent, self.last = deque(), None, 0
        self.tables = {}
        self.seed_bits, self.seed_number = [Bit() for _ in range(3)], Number()
        self.near, self.forward, self.near_steps = Bit(), Bit(), [Number(), Number()]
        self.border, self.back = [Bit() for _ in range(4)], Number()
        while len(self.triangles) < triangles:
            gate, self.urgent = self.urgent, None
            while gate is None or gate.state != OPEN:
                if not self.queue:
                    gate = None
                    break
                gate = self.queue.popleft()
            if gate is None:
                self.seed()
            else:
                self.symbol(gate)

    def new_vertex(self):
        if self.known >= self.vertices:
            raise Damaged("more vertices than the header says")
        self.known += 1
        return self.known - 1

    def earlier(self, back):
        if back >= self.known:
            raise Damaged("a vertex that does not exist")
        return self.known - 1 - back

    def triangle(self, *corners):
        for v in corners:
            self.degree[v] += 1
        self.triangles.append(corners)
        return len(self.triangles) - 1

    def gate(self, start, end, half_edge):
        gate = Gate(start, end, half_edge)
        self.latest[start] = gate
        return gate

    def fill(self, gate, half_edge):
        gate.state = FILLED
        self.opposite[gate.half_edge], self.opposite[half_edge] = half_edge, gate.half_edge

    def seed(self):
        corners = []
        for k in range(3):
            if self.seed_bits[k].decode(self.coder):
                corners.append(self.new_vertex())
            else:
                corners.append(self.earlier(self.seed_number.decode(self.coder)))
        a, b, c = corners
        t = self.triangle(a, b, c)
        gates = [self.gate(b, a, (t, 0)), self.gate(a, c, (t, 2)), self.gate(c, b, (t, 1))]
        for k in range(3):
            link(gates[k], gates[(k + 1) % 3])
        self.queue.extend(gates)

    def decision(self, name, kind, indices):
        models = [self.tables.setdefault((name, table, kind, i), Bit()) for table, i in enumerate(indices)]
        bit = self.coder.bit(sum(m.p() for m in models) // 3)
        for m in models:
            m.update(bit)
        return bit

    def symbol(self, gate):
        P, N = gate.previous, gate.next
        a, b, p, n = gate.start, gate.end, P.start, N.end
        kind = 1 if P.previous is N else 2 if P.previous is N.next else 0
        last = self.last

        def at(v, most):
            return min(self.degree[v] - 1, most)

        indices = (((at(a, 7) * 8 + at(b, 7)) * 3 + at(p, 2)) * 3 + at(n, 2), at(a, 7) * 5 + at(p, 4),
                   (at(b, 7) * 5 + at(n, 4)) * 4 + last)  # fmt: skip
        if self.decision("new", kind, indices):
            self.last = 0
            return self.attach(gate, self.new_vertex(), None)
        indices = (((at(a, 7) * 8 + at(p, 7)) * 3 + at(b, 2)) * 3 + at(n, 2),
                   (at(a, 7) * 5 + at(b, 4)) * 4 + last, at(a, 7))  # fmt: skip
        if P.state == OPEN and P is not gate and self.decision("previous", kind, indices):
            self.last = 1
            return self.close_previous(gate)
        indices = (((at(b, 7) * 8 + at(n, 7)) * 3 + at(a, 2)) * 3 + at(p, 2),
                   (at(b, 7) * 5 + at(a, 4)) * 4 + last, at(b, 7))  # fmt: skip
        if N.state == OPEN and N is not gate and self.decision("next", kind, indices):
            self.last = 2
            return self.close_next(gate)
        self.last = 3
        if self.near.decode(self.coder):
            forward = self.forward.decode(self.coder)
            steps = self.near_steps[forward].decode(self.coder) + 1
            if steps > 8:
                raise Damaged("steps")
            way = N if forward else P
            for _ in range(steps + forward):
                way = way.next if forward else way.previous
            return self.attach(gate, way.start, way)
        if self.border[(P.state == BORDER) + 2 * (N.state == BORDER)].decode(self.coder):
            gate.state = BORDER
            return None
        w = self.earlier(self.back.decode(self.coder))
        way = self.latest[w]
        return self.attach(gate, w, None if way is None or way.state == FILLED else way)

    def attach(self, gate, w, way):
        P, N, a, b = gate.previous, gate.next, gate.start, gate.end
        t = self.triangle(a, b, w)
        F, S = self.gate(a, w, (t, 2)), self.gate(w, b, (t, 1))
        if P is gate:
            P = S
        if N is gate:
            N = F
        link(P, F)
        if way is None or way is gate:
            link(F, S)
        else:
            B = F if way.previous is gate else way.previous
            link(F, way)
            link(B, S)
        link(S, N)
        self.fill(gate, (t, 0))
        self.urgent = F
        self.queue.append(S)

    def close_previous(self, gate):
        P, N, b = gate.previous, gate.next, gate.end
        p = P.start
        t = self.triangle(gate.start, b, p)
        self.fill(gate, (t, 0))
        self.fill(P, (t, 2))
        Q = P.previous
        if Q is N and N.state == OPEN:
            self.fill(N, (t, 1))
        elif Q is not gate:
            R = self.gate(p, b, (t, 1))
            link(Q, R)
            link(R, N)
            self.queue.append(R)

    def close_next(self, gate):
        P, N, a = gate.previous, gate.next, gate.start
        n = N.end
        t = self.triangle(a, gate.end, n)
        self.fill(gate, (t, 0))
        self.fill(N, (t, 1))
        M = N.next
        if M is not gate:
            R = self.gate(a, n, (t, 2))
            link(P, R)
            link(R, M)
            self.urgent = R


def dot(u, v):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def cross(u, v):
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def add(u, v):
    return [a + b for a, b in zip(u, v)]


def sub(u, v):
    return [a - b for a, b in zip(u, v)]


def scale(u, s):
    return [a * s for a in u]


STARTS = [0.05, 0.05, 0.24, 0.38, 0.5, 0.6, 0.68, 0.77, 0.8, 0.8]


class Weights:
    """A set of learned weights."""

    def __init__(self, start):
        self.start = start
        self.S, self.T, self.lengths, self.samples = [[0.0] * 3 for _ in range(3)], [0.0] * 3, 0.0, 0.0

    def weights(self, length):
        hold = 3 * ((self.lengths + length * length) / (self.samples + 1))
        M = [[self.S[i][j] + (hold if i == j else 0.0) for j in range(3)] for i in range(3)]
        b = [self.T[i] + hold * self.start[i] for i in range(3)]
        for k in range(3):
            if not M[k][k] > 0:
                return self.start
            for i in range(k + 1, 3):
                g = M[i][k] / M[k][k]
                for j in range(k, 3):
                    M[i][j] -= g * M[k][j]
                b[i] -= g * b[k]
        z = b[2] / M[2][2]
        y = (b[1] - M[1][2] * z) / M[1][1]
        x = (b[0] - M[0][1] * y - M[0][2] * z) / M[0][0]
        return [x, y, z]

    def learn(self, f, truth):
        for i in range(3):
            for j in range(3):
                self.S[i][j] += f[i] * f[j]
            self.T[i] += f[i] * truth

    def end_sample(self, length):
        self.lengths += length * length
        self.samples += 1
        if self.samples == 256:
            self.samples = 128.0
            self.lengths *= 0.5
            self.S = [[v * 0.5 for v in row] for row in self.S]
            self.T = [v * 0.5 for v in self.T]


class Positions:
    """Section 3: lattice coordinates of all vertices."""

    def __init__(self, coder, connectivity, vertices, largest):
        self.coder, self.largest = coder, largest
        self.triangles, self.opposite = connectivity.triangles, connectivity.opposite
        self.corners = [[] for _ in range(vertices)]
        for t, triangle in enumerate(self.triangles):
            for k, v in enumerate(triangle):
                self.corners[v].append((t, k))
        self.at, self.normal = [None] * vertices, [[0.0] * 3 for _ in range(vertices)]
        self.magnitudes = [(0.0, 0.0)] * vertices
        self.A = [Weights([STARTS[i % 10]] * 3) for i in range(50)]
        self.B = [Weights([0.5, 0.5, 0.0]) for _ in range(50)]
        self.errors, self.total = [[0.5, 0.25] for _ in range(50)], [1.0] * 50
        self.signs = [Bit(), Bit()]
        self.coded_last = [0.0] * 3
        self.sizes = [[Number() for _ in range(32)] for _ in range(2)]
        self.code_all(vertices)

    def code_all(self, vertices):
        count, stacks, first = [0] * vertices, [[] for _ in range(5)], 0
        for _ in range(vertices):
            v = None
            for stack in reversed(stacks[1:]):
                while stack and self.at[stack[-1]] is not None:
                    stack.pop()
                if stack:
                    v = stack.pop()
                    break
            if v is None:
                while self.at[first] is not None:
                    first += 1
                v = first
            self.code(v)
            for t, _ in self.corners[v]:
                if not all(self.at[c] is not None for c in self.triangles[t]):
                    continue
                for side in range(3):
                    other = self.opposite.get((t, side))
                    if other is None:
                        continue
                    u = self.triangles[other[0]][(other[1] + 2) % 3]
                    if self.at[u] is None and count[u] < 4:
                        count[u] += 1
                        stacks[count[u]].append(u)

    def residual(self, expected, kind):
        m = int(math.floor(4 * (expected * expected))).bit_length()
        shift = max(max(m - 2, 0) // 2 - 1, 0)
        size = self.sizes[kind][m - 2 * shift].decode(self.coder) * 2**shift + self.coder.raw(shift)
        if size > 0 and self.signs[kind].decode(self.coder):
            return -size
        return size

    def code(self, v):
        at = self.at
        neighbours, normals0, normals1 = [0.0] * 3, [0.0] * 3, [0.0] * 3
        across_sum, along_sum, middle_sum = [0.0] * 3, [0.0] * 3, [0.0] * 3
        near, neighbour_count, length, count = [0.0, 0.0], 0, 0.0, 0
        for t, k in self.corners[v]:
            x, y = self.triangles[t][(k + 1) % 3], self.triangles[t][(k + 2) % 3]
            for u in (x, y):
                if at[u] is not None:
                    neighbours, normals1 = add(neighbours, at[u]), add(normals1, self.normal[u])
                    neighbour_count += 1
                    near = [a + b for a, b in zip(near, self.magnitudes[u])]
            other = self.opposite.get((t, (k + 1) % 3))
            if at[x] is None or at[y] is None or other is None:
                continue
            c = self.triangles[other[0]][(other[1] + 2) % 3]
            if at[c] is None:
                continue
            X, Y, C = at[x], at[y], at[c]
            edge, middle = sub(Y, X), scale(add(X, Y), 0.5)
            reach, square = sub(middle, C), dot(edge, edge)
            along = scale(edge, dot(reach, edge) / square if square != 0 else 0.0)
            across_sum, along_sum = add(across_sum, sub(reach, along)), add(along_sum, along)
            middle_sum, normals0 = add(middle_sum, middle), add(normals0, cross(sub(X, C), sub(Y, C)))
            length += math.sqrt(square)
            count += 1
        cls = min(count, 4) * 10 + min(len(self.corners[v]) - count, 9)
        if neighbour_count > 0:
            base = scale(neighbours, 1 / neighbour_count)
            near = [m / neighbour_count for m in near]
        else:
            base, near = list(self.coded_last), [0.0, 0.0]
        A, B, f = self.A[cls], self.B[cls], None
        guess, expected = list(base), [self.largest / 16] * 2
        if count > 0:
            share = 1 / count
            f = [scale(across_sum, share), scale(along_sum, share), sub(scale(middle_sum, share), base)]
            length *= share
            for part, w in zip(f, A.weights(length)):
                guess = add(guess, scale(part, w))
            expected = [0.35 * near[k] + 0.65 * (self.errors[cls][k] / self.total[cls] * length) for k in (0, 1)]
        expected = [min(e, 2.0**24) for e in expected]
        w = 0
        for k in (1, 2):
            if abs(normals0[k]) >= abs(normals0[w]):
                w = k
        iu, iv = (w + 1) % 3, (w + 2) % 3
        position, residuals = [0.0] * 3, []

        def coordinate(axis, wanted, e, kind):
            predicted = 0 if wanted != wanted else min(max(math.floor(wanted + 0.5), 0), self.largest)
            r = self.residual(e, kind)
            residuals.append(abs(r))
            position[axis] = float(predicted + r)
            if not 0 <= position[axis] <= self.largest:
                raise Damaged("position")

        coordinate(iu, guess[iu], expected[0], 0)
        coordinate(iv, guess[iv], 0.75 * expected[0] + 0.25 * residuals[0], 0)
        wanted, h = guess[w], [0.0, 0.0, 0.0]
        if count > 0:

            def slope(n, du, dv):
                return -(n[iu] * du + n[iv] * dv) / n[w]

            def limit(height):
                return min(max(height, -4 * length), 4 * length)

            du, dv = position[iu] - base[iu], position[iv] - base[iv]
            if normals0[w] != 0:
                h[0] = limit(slope(normals0, du, dv))
                h[2] = limit((guess[w] - base[w]) - slope(normals0, guess[iu] - base[iu], guess[iv] - base[iv]))
            if normals1[w] != 0:
                h[1] = limit(slope(normals1, du, dv))
            b = B.weights(length)
            wanted = base[w] + h[0] * b[0] + h[1] * b[1] + h[2] * b[2]
        coordinate(w, wanted, expected[1], 1)
        at[v], self.coded_last = position, position
        self.magnitudes[v] = ((residuals[0] + residuals[1]) * 0.5, float(residuals[2]))
        if count > 0:
            for k in range(3):
                A.learn([f[0][k], f[1][k], f[2][k]], position[k] - base[k])
            A.end_sample(length)
            B.learn(h, position[w] - base[w])
            B.end_sample(length)
            self.errors[cls] = [a + b for a, b in zip(self.errors[cls], self.magnitudes[v])]
            self.total[cls] += length
        for t, _ in self.corners[v]:
            corners = self.triangles[t]
            if all(at[c] is not None for c in corners):
                a, b, c = (at[i] for i in corners)
                n = cross(sub(b, a), sub(c, a))
                for i in corners:
                    self.normal[i] = add(self.normal[i], n)


def decode(data):
    """Positions (lists of three singles) and triangles."""
    if data[0] != 0:
        raise Damaged("version of MESH")
    coder, header = Range(data[1:]), Number()
    vertices, triangles, bits = (header.decode(coder) for _ in range(3))
    origin, step = [coder.float() for _ in range(3)], coder.float()
    connectivity = Connectivity(coder, vertices, triangles)
    if not all(abs(to_single(o + i * step)) <= to_single(1e12) for o in origin for i in (0, 2**bits - 1)):
        raise Damaged("lattice of MESH beyond 1e12")
    lattice = Positions(coder, connectivity, vertices, 2**bits - 1).at
    coder.end_mark()
    if not coder.ends_rightly(max(vertices, triangles) // 16384):
        raise Damaged("end of MESH")
    return [[to_single(o + i * step) for o, i in zip(origin, p)] for p in lattice], connectivity.triangles
