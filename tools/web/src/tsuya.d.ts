/**
 * Decoder of `.tsuya` files. ES modules that work from plain static files: `tsuya.js`, `tsuya.wasm` and the other files of this
 * folder lie beside each other.
 *
 * All pictures are row-major from the top left pixel. World coordinates, cameras (OpenCV axes: x right, y down, z forward) and lights are
 * those of the file; `Facts.upright` turns them for a world whose y is up.
 */

/** Opens a file. Resolves as soon as its views are known; nothing but what is asked for is fetched after that. */
export function openTsuya(source: TsuyaSource, options?: OpenOptions): Promise<TsuyaFile>;

/** An address (relative ones against the page), a file that was dropped or chosen, or bytes. Bytes are not copied where no worker is used. */
export type TsuyaSource = URL | string | Blob | ArrayBuffer | Uint8Array;

export interface OpenOptions {
  /** Ends opening and everything that the file does later: what is under way rejects with the signal's reason. */
  signal?: AbortSignal;
  /** The file is this part of the source, e.g. a bufferView of a GLB: `offset` from its start, `length` in bytes. */
  range?: { offset: number; length: number };
  /** For `fetch`: headers, credentials, mode. */
  request?: RequestInit;
  /** Where the module lies, its bytes, or the compiled module. Default: `tsuya.wasm` beside `tsuya.js`. */
  wasm?: URL | string | ArrayBuffer | WebAssembly.Module;
  /** Decode in a worker. Default: true where the platform has workers. */
  worker?: boolean;
  /** Most memory that the file may ask for, in MiB. Default 1024. */
  memoryMib?: number;
  /** Called when bytes have arrived. */
  onProgress?: (progress: Progress) => void;
}

export interface Progress {
  /** Bytes taken from the source so far. */
  received: number;
  /** Length of the file, where it is known. */
  total: number | null;
}

/** Options of every operation. Aborting rejects this operation with the signal's reason and leaves the file open. */
export interface Options {
  signal?: AbortSignal;
}

export interface TsuyaFile {
  /** What is known without decoding pictures. */
  readonly facts: Facts;
  /** The captured views: cameras and lights, in the capture's order. */
  readonly views: ReadonlyArray<CapturedView>;
  /** The order in which views are coded: key views first, each prefix spread evenly about the object. Empty in profile `wavelet-texture`. */
  readonly order: ReadonlyArray<CodedView>;
  /** Bytes taken from the source so far, and the file's length. */
  readonly progress: Progress;

  /** The mesh, cut along the borders of the atlas' charts as glTF wants it; null where the file has none. */
  mesh(options?: Options): Promise<Mesh | null>;
  /** The finer surface that photographs show of the mesh; null where the file has none, or one of more than two million triangles. */
  surface(options?: Options): Promise<Surface | null>;
  /** The fitted reflectance; null where the file has none. */
  reflectance(options?: Options): Promise<Reflectance | null>;
  /** What the vertices see; null where the file has none. Its place is behind the photographs. */
  visibility(options?: Options): Promise<Visibility | null>;
  /** Light to show the object in; null where the file has none. Its place is behind the photographs. */
  light(options?: Options): Promise<Light | null>;
  /** Fitted materials, an empty list where the file has none. Its place is behind the photographs. */
  materials(options?: Options): Promise<Material[]>;

  /**
   * Decodes a view, with those it is predicted from where they are not decoded yet. Views asked for side by side are decoded in the
   * order in which they were asked for.
   */
  view(index: number, options?: OneViewOptions): Promise<DecodedView>;
  /** All views (or those asked for) one after the other, in coding order, each as soon as its bytes have arrived. */
  decodeViews(options?: AllViewsOptions): AsyncIterableIterator<DecodedView>;

  /** Fetches the rest of the file and compares every checksum. */
  verify(options?: Options): Promise<void>;
  /** Ends what is under way (it rejects with an `AbortError`) and frees the memory. */
  close(): void;
}

export type Component = "diffuse" | "specular" | "combined";

export interface Facts {
  /** `major.minor` of the format. */
  version: string;
  /** `predictive`, `wavelet-texture`, or null for a file without photographs. */
  profile: "predictive" | "wavelet-texture" | null;
  /** Sections known so far; all of them once `sectionsComplete`. */
  sections: SectionFacts[];
  sectionsComplete: boolean;
  /** The file's metadata, as written. */
  metadata: Record<string, unknown>;
  title: string | null;
  licence: string | null;
  /** Unit of world lengths: `m`, `cm`, `mm` or another word. */
  units: string | null;
  /** Errors against the captured photographs that the encoder states, in dB of image PSNR; null where it states none. */
  statedError: {
    diffuse_psnr_db?: number;
    specular_psnr_db?: number;
    sum_psnr_db?: number;
    /** Largest error of `sqrt(radiance / white)`. */
    largest?: number;
  } | null;
  /** The pictures that each view has, in this order. */
  components: Component[];
  /** Radiance of the white board: `sqrt(radiance / white)` is the domain of the stated errors and a good display scale. */
  white: [number, number, number];
  /** Unit quaternion x, y, z, w that turns the object's world upright (y up), as the glTF export does; null where nothing has to be turned. */
  upright: [number, number, number, number] | null;
  /** Metres for one unit of the world, as the glTF export takes them: 0.001, 0.01 or 1. */
  metres: number;
}

export interface SectionFacts {
  tag: string;
  /** Where its header begins. */
  offset: number;
  /** Bytes in the file, header included. */
  bytes: number;
}

export interface CapturedView {
  name: string;
  camera: Camera;
  light: PointLight | null;
}

/**
 * A pinhole camera. A world point `p` has camera coordinates `q = rotation p + translation` and the image position
 * `(focal[0] q.x / q.z + principal[0], focal[1] q.y / q.z + principal[1])`; pixel (0, 0) covers 0 to 1.
 */
export interface Camera {
  width: number;
  height: number;
  focal: [number, number];
  principal: [number, number];
  /** Rows. */
  rotation: [[number, number, number], [number, number, number], [number, number, number]];
  translation: [number, number, number];
}

/** Irradiance at distance `r` is `intensity / r^2`. */
export interface PointLight {
  position: [number, number, number];
  intensity: [number, number, number];
}

export interface CodedView {
  view: number;
  /** Views it is predicted from. */
  needs: number[];
  /** Where its bytes lie in the file. */
  offset: number;
  bytes: number;
}

export interface Mesh {
  /** Three for each vertex. */
  positions: Float32Array;
  /** Unit vectors, smooth; three for each vertex. */
  normals: Float32Array;
  /** x, y, z, handedness as in glTF; empty without an atlas. */
  tangents: Float32Array;
  /** Atlas coordinates as in glTF, 0 to 1, v downwards; empty without an atlas. */
  uvs: Float32Array;
  /** Three for each triangle, counter-clockwise from outside. */
  indices: Uint32Array;
  /** For each vertex its number in the file's own mesh, before it was cut: the numbers of `Visibility.weights`. */
  sourceVertices: Uint32Array;
  /** Vertices of the file's own mesh. */
  sourceVertexCount: number;
}

/** The mesh subdivided and displaced, cut along the borders of the atlas' charts. Photographs and reflectance are of this surface. */
export interface Surface {
  /** Three for each vertex. */
  positions: Float32Array;
  /** Unit vectors, smooth; three for each vertex. */
  normals: Float32Array;
  /** As the mesh's; a place has those of the place on the mesh that it was before it was displaced. */
  uvs: Float32Array;
  /** Three for each triangle, counter-clockwise from outside. */
  indices: Uint32Array;
  between: {
    /** For each vertex the three vertices of the file's own mesh that it lies between: the numbers of `Visibility.weights`. */
    vertices: Uint32Array;
    /** Their shares, which sum to 1. */
    weights: Float32Array;
  };
}

/**
 * Maps on the atlas, `width * height` texels from the top left; the texel under `uvs` (u, v) is the one at
 * `(u * width, v * height)`, centres at 0.5. Texels that no chart reaches are filled from their neighbours.
 *
 * A point light of intensity `L` at distance `r` gives, with `E = L / r^2`: diffuse radiance `K_d E cos(theta_i)`, specular radiance
 * `K_s E exp(-alpha^2 / (2 sigma^2)) / cos(theta_r)`; `alpha` is the angle between normal and half vector. Of a file with a palette of
 * measured lobes, or with GGX lobes, `K_s` and `sigma` are those of the nearest such highlights. With GGX lobes `diffuse` is that of a layer under
 * a dielectric surface: `spec/rendering.md` has both formulas.
 */
export interface Reflectance {
  width: number;
  height: number;
  /** False where the lights were unknown: `diffuse` is then mean radiance. */
  relightable: boolean;
  /** `K_d`: red, green, blue, 1 where a chart is (0 in filled texels). */
  diffuse: Float32Array;
  /** `K_s` as red, green, blue, and `sigma` in radians; null without a specular component. */
  specular: Float32Array | null;
  /** GGX lobes of rising roughness `alpha`, with their weights `W_k` as red, green, blue; none in files of other models. */
  lobes: { roughness: number; weights: Float32Array }[];
}

/**
 * Signed angle to the border of what is free, for each vertex and direction:
 * `distance = mean(direction) + sum over k of weight(vertex, k) base(direction, k)`; positive where the direction is free.
 */
export interface Visibility {
  /** Cells along a side of the octahedral grid of directions. */
  size: number;
  terms: number;
  /** The first group alone serves for broad lobes. */
  groups: [number, number];
  /** Whether an endless plane below the object blocks, too. */
  ground: boolean;
  /** `size * size` cells of `1 + terms`: the mean, then the bases, weights' steps multiplied in. */
  bases: Float32Array;
  /** `sourceVertexCount * terms`; what a file has between the vertices is left out. */
  weights: Int8Array;
  rmsErrorRad: number;
  wrongSigns: number;
}

/** Light from all around. Octahedral grids as in `spec/lighting.md`. */
export interface Light {
  /** Spherical Gaussians `amplitude exp(sharpness (axis . direction - 1))`, seven numbers each: axis, sharpness, amplitude. */
  lobes: Float32Array;
  /** Mean radiance over a lobe of the sharpness about each direction. */
  levels: { sharpness: number; size: number; cells: Float32Array }[];
}

export interface Material {
  name: string;
  form: "dsbrdf" | "compact";
  /**
   * BRDF values (1/sr) over the half angle, the difference angle and its azimuth: `size[0] * size[1] * size[2]` times red, green, blue, the
   * azimuth fastest. Half angles are `(i / size[0])^2 * 90` degrees as in MERL's tables, difference angles 0 to 90 and azimuths 0 to 180
   * degrees in equal steps. Cells below the horizon are 0.
   */
  size: [number, number, number];
  values: Float32Array;
}

export interface ViewOptions extends Options {
  /** `float32` (default): linear radiance exactly as the native decoder's; `half`: rounded to 16 bits, for textures. */
  format?: "float32" | "half";
  /** The components wanted; default all. All are decoded, but only these are handed out. */
  components?: Component[];
}

export interface OneViewOptions extends ViewOptions {
  /** A view of this file that is not needed any more: its arrays are used again and must not be read then. */
  reuse?: DecodedView | null;
}

export interface AllViewsOptions extends ViewOptions {
  /** The views wanted; default all. */
  views?: Iterable<number>;
  /**
   * A view's arrays are used again as soon as the next one is asked for, which saves time, and must not be read then. Default false.
   */
  reuse?: boolean;
}

export interface DecodedView {
  index: number;
  width: number;
  height: number;
  /** 1 where a pixel shows the object. */
  mask: Uint8Array;
  /** Linear radiance, four numbers a pixel: red, green, blue, mask. `Uint16Array` holds half floats. Specular may be negative. */
  images: Partial<Record<Component, Float32Array | Uint16Array>>;
  /** Milliseconds that decoding took in the worker, views it needed first included. */
  milliseconds: number;
}

/** Everything that goes wrong, but for aborts. */
export class TsuyaError extends Error {
  name: "TsuyaError";
  /**
   * `io`: the source can't be read; `format`: the file is wrong; `unsupported`: right, but not for this version; `limits`: it asks for more memory
   * than allowed; `parameter`: the caller asked for what there is not; `internal`: the decoder failed, which a file should never make it do.
   */
  kind: "io" | "format" | "unsupported" | "limits" | "parameter" | "internal";
  /** The address or file name, where there is one. */
  source: string | null;
  /** Four letters of the section that is wrong (`file` outside of sections) and the byte in it. */
  section: string | null;
  offset: number | null;
}
