"""The same pictures from Mitsuba 3: direct light of an environment on one mesh, with tsuya's reflection models as BSDFs."""

import json
import os

import numpy as np
import drjit as dr
import mitsuba as mi

mi.set_variant("llvm_ad_rgb")


def read_obj(path):
    """Positions and triangles of an OBJ file, polygons cut into fans."""
    positions, triangles = [], []
    for line in open(path):
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            positions.append([float(x) for x in words[1:4]])
        elif words[0] == "f":
            corners = [int(w.split("/")[0]) - 1 for w in words[1:]]
            triangles += [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]
    return np.array(positions, np.float32), np.array(triangles, np.uint32)


def mesh_of(path, bsdf):
    """The mesh with normals weighted by area, as tsuya has them (Mitsuba's own are weighted by angle)."""
    positions, triangles = read_obj(path)
    corners = positions[triangles].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros(positions.shape)
    for k in range(3):
        np.add.at(normals, triangles[:, k], across)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    mesh = mi.Mesh("object", len(positions), len(triangles), has_vertex_normals=True, props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.ravel(positions)
    parameters["vertex_normals"] = np.ravel(normals.astype(np.float32))
    parameters["faces"] = np.ravel(triangles)
    parameters.update()
    return mesh


def triple(value, default):
    value = default if value is None else value
    return [float(value)] * 3 if np.isscalar(value) else [float(x) for x in value]


class Reflection(mi.BSDF):
    """Lambert plus one specular model, the formulas of src/brdf/models/lobe.rs; drawn by the cosine, or by the half vector."""

    material = None

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        m = Reflection.material
        self.model = m["model"]
        specular = self.model != "lambert"
        self.albedo = mi.Color3f(triple(m.get("diffuse"), 0.0 if specular else 0.5))
        self.scale = mi.Color3f(triple(m.get("specular"), 1.0))
        self.f0 = m.get("reflectance", 1.0)
        pair = lambda v: [float(v)] * 2 if np.isscalar(v) else [float(x) for x in v]
        self.roughness = pair(m.get("roughness", 0.0))
        self.exponent = pair(m.get("exponent", 0.0))
        self.coefficients = m.get("coefficients", [-1, 1])
        self.ggx = m.get("distribution") == "ggx"
        flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
        if self.model in ("ward", "ashikhmin-shirley"):
            flags |= mi.BSDFFlags.Anisotropic
        self.m_components = [flags]
        self.m_flags = flags
        if self.model == "blinn-phong":
            self.slope = (2 / (self.exponent[0] + 2)) ** 0.5
        elif self.model == "ashikhmin-shirley":
            self.slope = (2 / (min(self.exponent) + 2)) ** 0.5
        elif self.model == "lafortune":
            self.slope = (8 / (self.exponent[0] + 2)) ** 0.5
        else:
            self.slope = max(self.roughness)
        if self.model == "torrance-sparrow":
            self.slope *= 2**0.5

    def value(self, i, o):
        ci, co = i.z, o.z
        h = dr.normalize(i + o)
        oh = dr.maximum(dr.dot(o, h), 1e-9)
        z = dr.maximum(h.z, 1e-9)
        schlick = self.f0 + (1 - self.f0) * dr.power(dr.maximum(1 - oh, 0), 5)
        pi, n = dr.pi, self.exponent
        if self.model == "lambert":
            return self.albedo / pi
        if self.model == "blinn-phong":
            f = mi.Color3f((n[0] + 2) / (2 * pi) * dr.power(z, n[0]))
        elif self.model == "cook-torrance":
            z2, m2 = z * z, self.roughness[0] ** 2
            if self.ggx:
                smith = lambda c: 2 / (1 + dr.sqrt(1 + m2 * (1 / (c * c) - 1)))
                d, g = m2 / (pi * dr.square(z2 * (m2 - 1) + 1)), smith(ci) * smith(co)
            else:
                d = dr.exp(-(1 / z2 - 1) / m2) / (pi * m2 * z2 * z2)
                g = dr.minimum(1, dr.minimum(2 * z * co / oh, 2 * z * ci / oh))
            f = mi.Color3f(schlick * d * g / (4 * ci * co))
        elif self.model == "ward":
            ax, ay = self.roughness
            exponent = (dr.square(h.x / ax) + dr.square(h.y / ay)) / (z * z)
            f = mi.Color3f(dr.exp(-exponent) / (4 * pi * ax * ay * dr.sqrt(ci * co)))
        elif self.model == "ashikhmin-shirley":
            sine = h.x * h.x + h.y * h.y
            exponent = dr.select(sine > 1e-18, (n[0] * h.x * h.x + n[1] * h.y * h.y) / sine, n[0])
            scale = ((n[0] + 1) * (n[1] + 1)) ** 0.5 / (8 * pi)
            f = mi.Color3f(schlick * scale * dr.power(z, exponent) / (oh * dr.maximum(ci, co)))
        elif self.model == "lafortune":
            xy, along = self.coefficients
            inner = (xy * (i.x * o.x + i.y * o.y) + along * ci * co) / max(abs(xy), abs(along))
            f = mi.Color3f((n[0] + 2) / (2 * pi) * dr.power(dr.maximum(inner, 0), n[0]))
        else:
            alpha = dr.acos(dr.minimum(z, 1)) / self.roughness[0]
            f = mi.Color3f(dr.exp(-0.5 * alpha * alpha) / (dr.maximum(co, 0.05) * dr.maximum(ci, 1e-3)))
        return self.albedo / pi + self.scale * f

    def density(self, i, o):
        cosine = i.z / dr.pi
        if self.model == "lambert":
            return cosine
        h = dr.normalize(i + o)
        m2 = self.slope**2
        z2 = h.z * h.z
        d = dr.exp(-(1 / z2 - 1) / m2) / (dr.pi * m2 * z2 * z2)
        return 0.3 * cosine + 0.7 * d * h.z / dr.maximum(4 * dr.dot(o, h), 1e-6)

    def sample(self, ctx, si, sample1, sample2, active):
        o = si.wi
        diffuse = mi.warp.square_to_cosine_hemisphere(sample2)
        i = diffuse
        if self.model != "lambert":
            tangent = dr.sqrt(-(self.slope**2) * dr.log(1 - sample2.x))
            s, c = dr.sincos(2 * dr.pi * sample2.y)
            z = dr.rsqrt(1 + tangent * tangent)
            h = mi.Vector3f(c * tangent * z, s * tangent * z, z)
            i = dr.select(sample1 < 0.3, diffuse, 2 * dr.dot(o, h) * h - o)
        sample = mi.BSDFSample3f()
        sample.wo = i
        sample.eta = 1
        sample.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        sample.sampled_component = 0
        active &= (i.z > 0) & (o.z > 0)
        sample.pdf = dr.select(active, self.density(i, o), 0)
        value = dr.select(active & (sample.pdf > 0), self.value(i, o) * i.z / sample.pdf, 0)
        return sample, value

    def eval(self, ctx, si, wo, active):
        active &= (si.wi.z > 0) & (wo.z > 0)
        return dr.select(active, self.value(wo, si.wi) * wo.z, 0)

    def pdf(self, ctx, si, wo, active):
        active &= (si.wi.z > 0) & (wo.z > 0)
        return dr.select(active, self.density(wo, si.wi), 0)

    def eval_pdf(self, ctx, si, wo, active):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def to_string(self):
        return "Reflection[]"


mi.register_bsdf("tsuya_reflection", Reflection)


def render(job, folder, samples):
    """Linear picture of a job (a dictionary as `tsuya render --job` reads it), `samples` paths a pixel, at least two parts of 64: its
    mean, and half the difference of its two halves, which is its noise."""
    at = lambda name: os.path.join(folder, name)
    Reflection.material = job["material"]
    bsdf = mi.load_dict({"type": "tsuya_reflection"})
    camera, light = job["camera"], job["environment"]
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], light.get("rotation_y_deg", 0.0))
    scene = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "direct", "hide_emitters": True},
        "object": mesh_of(at(job["mesh"]), bsdf),
        "light": {"type": "envmap", "filename": at(light["file"]), "scale": light.get("scale", 1.0), "to_world": turn},
        "sensor": {
            "type": "perspective",
            "fov": camera["fov_y_deg"],
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(camera["position"], camera["target"], camera["up"]),
            "film": {"type": "hdrfilm", "width": job["size"][0], "height": job["size"][1], "pixel_format": "rgb",
                     "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
    })
    parts = max(2, samples // 64 // 2 * 2)
    halves = [0.0, 0.0]
    for k in range(parts):
        halves[k % 2] = halves[k % 2] + np.array(mi.render(scene, spp=64, seed=k)) * (2 / parts)
    return (halves[0] + halves[1]) / 2, (halves[0] - halves[1]) / 2


if __name__ == "__main__":
    import sys
    job_file, out, samples = sys.argv[1], sys.argv[2], int(sys.argv[3])
    picture, _ = render(json.load(open(job_file)), os.path.dirname(os.path.abspath(job_file)), samples)
    mi.Bitmap(picture.astype(np.float32)).write(out)
