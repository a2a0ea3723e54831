/* The decoder of .tsuya files.

   Everything that a function returns by pointer belongs to the object that it came from and lives as long as that; objects are freed by the function
   of their name that ends with _free. Functions that can fail return a status and, where `error` is not null, put an error there that the caller
   frees. Objects may be used by several threads at once, but for freeing them. No function ends the program, whatever a file holds, and none asks
   for more memory than its limits allow.

   Images are rows from the top, pixels red green blue, linear radiance (Rec. 709) unless something else is said. Positions are in the
   capture's units, right-handed; cameras have OpenCV's axes: x right, y down, z forward. */

#ifndef TSUYA_H
#define TSUYA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// How a call went.
typedef enum {
  // Well.
  TSUYA_STATUS_OK = 0,
  // An argument is wrong.
  TSUYA_STATUS_PARAMETER = 1,
  // The system refused to read.
  TSUYA_STATUS_IO = 2,
  // The file is wrong.
  TSUYA_STATUS_FORMAT = 3,
  // The file asks for more than the limits allow.
  TSUYA_STATUS_LIMITS = 4,
  // Valid, but not read by this version.
  TSUYA_STATUS_UNSUPPORTED = 5,
  // The file does not hold what was asked for.
  TSUYA_STATUS_ABSENT = 6,
  // A defect of the library.
  TSUYA_STATUS_INTERNAL = 7,
} TsuyaStatus;

// Component of reflection that an image shows.
typedef enum {
  // Diffuse reflection.
  TSUYA_COMPONENT_DIFFUSE = 0,
  // Specular reflection. May be negative.
  TSUYA_COMPONENT_SPECULAR = 1,
  // Both together, of a capture without polarisers.
  TSUYA_COMPONENT_COMBINED = 2,
} TsuyaComponent;

// Which mesh.
typedef enum {
  // The mesh of the capture: positions and triangles.
  TSUYA_MESH_KIND_CAPTURED = 0,
  // The finest surface that the file has, with normals, tangents and texture coordinates.
  TSUYA_MESH_KIND_DRAWN = 1,
  // The mesh of the capture with normals, tangents and texture coordinates, for tsuya_textures(), whose normal map has the rest.
  TSUYA_MESH_KIND_TEXTURED = 2,
} TsuyaMeshKind;

// An open file.
typedef struct TsuyaAsset TsuyaAsset;

// What went wrong, as a sentence.
typedef struct TsuyaError TsuyaError;

// A decoded photograph.
typedef struct TsuyaPhotograph TsuyaPhotograph;

// Bounds on what a file may ask for.
typedef struct {
  // Bytes of memory for everything that the file sizes, together.
  uint64_t memory_bytes;
  // Views.
  uint32_t views;
  // Width or height of an image, in pixels.
  uint32_t image_side;
  // Vertices or triangles of the mesh.
  uint32_t mesh_elements;
} TsuyaLimits;

// A pinhole camera: a world point p has camera coordinates q = rotation p + translation and the image position
// (focal[0] q.x / q.z + principal[0], focal[1] q.y / q.z + principal[1]); pixel (0, 0) covers 0 to 1.
typedef struct {
  // Width of the image in pixels.
  uint32_t width;
  // Height of the image in pixels.
  uint32_t height;
  // Focal lengths in pixels.
  double focal[2];
  // Principal point in pixels.
  double principal[2];
  // World to camera, rows.
  double rotation[3][3];
  // World to camera.
  double translation[3];
} TsuyaCamera;

// A point light: irradiance at distance r is intensity / r^2.
typedef struct {
  // World position.
  double position[3];
  // Radiant intensity, red, green, blue.
  double intensity[3];
} TsuyaPointLight;

// A captured view.
typedef struct {
  // Name of the photograph, UTF-8; belongs to the asset.
  const char *name;
  // Its camera.
  TsuyaCamera camera;
  // Whether its light is known.
  bool has_light;
  // Its light, zero where it is not known.
  TsuyaPointLight light;
} TsuyaView;

// Vertices and triangles; the memory belongs to the asset.
typedef struct {
  // Vertices.
  size_t vertex_count;
  // Positions, three numbers for each vertex.
  const float *positions;
  // Unit normals, three for each vertex; null of TSUYA_MESH_KIND_CAPTURED.
  const float *normals;
  // Tangents, four for each vertex: the direction of growing u, and the sign with which normal x tangent points up in the texture; or null.
  const float *tangents;
  // Texture coordinates, two for each vertex, v downwards as the rows of textures; or null.
  const float *texture_coordinates;
  // Triangles.
  size_t triangle_count;
  // Vertices of each triangle, three, counter-clockwise from outside.
  const uint32_t *triangles;
} TsuyaMesh;

// A rectangle of an image, in pixels.
typedef struct {
  // First column.
  uint32_t left;
  // First row.
  uint32_t top;
  // Columns.
  uint32_t width;
  // Rows.
  uint32_t height;
} TsuyaRegion;

// A texture of three bytes for each texel, rows from the top; the memory belongs to the asset. All zero where there is none.
typedef struct {
  // Columns.
  uint32_t width;
  // Rows.
  uint32_t height;
  // width x height x 3 bytes.
  const uint8_t *texels;
} TsuyaTexture;

// The fitted reflectance as glTF's metallic-roughness model takes it, on the mesh TSUYA_MESH_KIND_TEXTURED.
typedef struct {
  // Base colour, sRGB.
  TsuyaTexture base_colour;
  // Green: roughness, blue: metalness; linear. None for a surface without highlights.
  TsuyaTexture metallic_roughness;
  // Specular colour, sRGB, to be multiplied with `specular_scale`; or none.
  TsuyaTexture specular_colour;
  // Factor of the specular colour.
  float specular_scale;
  // Normals of a surface finer than the mesh, 0 to 255 for -1 to 1: tangent, up in the texture, normal; or none.
  TsuyaTexture normal;
  // Whether the base colour is the light that was seen, since that of the capture is unknown: to be shown unlit.
  bool is_unlit;
} TsuyaTextures;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The limits that are taken where none are given: 4 GiB of memory.
TsuyaLimits tsuya_default_limits(void);

// Version of the library, such as "0.1.0".
const char *tsuya_version(void);

// Opens a file in memory, which is copied. `limits` may be null. Metadata, views and mesh are decoded now, the rest when it is asked for.
//
// # Safety
// `bytes` points to so many bytes; `limits` and `error` are null or valid; `asset` can be written to.
TsuyaStatus tsuya_open_memory(const uint8_t *bytes,
                              size_t length,
                              const TsuyaLimits *limits,
                              TsuyaAsset **asset,
                              TsuyaError **error);

// Opens a file by its path, UTF-8. It stays where it is and as it is until the asset is freed: only what is asked for is read.
//
// # Safety
// `path` ends with a zero; `limits` and `error` are null or valid; `asset` can be written to.
TsuyaStatus tsuya_open_file(const char *path,
                            const TsuyaLimits *limits,
                            TsuyaAsset **asset,
                            TsuyaError **error);

// Frees an asset and all that belongs to it, but not its photographs; null is left alone.
//
// # Safety
// `asset` is null or an asset that was not freed, and nothing that belongs to it is used any more.
void tsuya_asset_free(TsuyaAsset *asset);

// What the file says of itself, a JSON object in UTF-8: title, licence, units, its stated error. Null for null.
//
// # Safety
// `asset` is null or an asset that was not freed.
const char *tsuya_metadata(const TsuyaAsset *asset);

// Number of captured views.
//
// # Safety
// `asset` is null or an asset that was not freed.
uint32_t tsuya_view_count(const TsuyaAsset *asset);

// Number of components of each photograph: two of polarised captures (diffuse and specular), else one.
//
// # Safety
// `asset` is null or an asset that was not freed.
uint32_t tsuya_component_count(const TsuyaAsset *asset);

// Which component the images of this number show.
//
// # Safety
// `asset` and `error` are null or valid; `component` can be written to.
TsuyaStatus tsuya_component(const TsuyaAsset *asset, uint32_t number, TsuyaComponent *component, TsuyaError **error);

// Radiance of the white board, red, green, blue: what is white in the photographs.
//
// # Safety
// `asset` and `error` are null or valid; `white` has room for three numbers.
TsuyaStatus tsuya_white(const TsuyaAsset *asset, double *white, TsuyaError **error);

// Name, camera and light of a view.
//
// # Safety
// `asset` and `error` are null or valid; `view` can be written to.
TsuyaStatus tsuya_view(const TsuyaAsset *asset, uint32_t index, TsuyaView *view, TsuyaError **error);

// What went wrong: a sentence in UTF-8. Empty for null.
//
// # Safety
// `error` is null or an error that was not freed.
const char *tsuya_error_message(const TsuyaError *error);

// Frees an error; null is left alone.
//
// # Safety
// `error` is null or an error that was not freed.
void tsuya_error_free(TsuyaError *error);

// A mesh of the file; `kind` is a TsuyaMeshKind.
//
// # Safety
// `asset` and `error` are null or valid; `mesh` can be written to.
TsuyaStatus tsuya_mesh(const TsuyaAsset *asset, uint32_t kind, TsuyaMesh *mesh, TsuyaError **error);

// Decodes the photograph of a view. `reduction` halves its size so often, 0 to 5, and nothing of the finer levels is read; `region` is the part to
// decode, in pixels of that size, or null for all of it. TSUYA_STATUS_ABSENT where the file holds none of this view.
//
// # Safety
// `asset`, `region` and `error` are null or valid; `photograph` can be written to.
TsuyaStatus tsuya_decode_view(const TsuyaAsset *asset,
                              uint32_t view,
                              uint8_t reduction,
                              const TsuyaRegion *region,
                              TsuyaPhotograph **photograph,
                              TsuyaError **error);

// Frees a photograph; null is left alone.
//
// # Safety
// `photograph` is null or a photograph that was not freed.
void tsuya_photograph_free(TsuyaPhotograph *photograph);

// Width in pixels; 0 for null.
//
// # Safety
// `photograph` is null or a photograph that was not freed.
uint32_t tsuya_photograph_width(const TsuyaPhotograph *photograph);

// Height in pixels; 0 for null.
//
// # Safety
// `photograph` is null or a photograph that was not freed.
uint32_t tsuya_photograph_height(const TsuyaPhotograph *photograph);

// Its camera, that of the decoded size and region.
//
// # Safety
// `photograph` and `error` are null or valid; `camera` can be written to.
TsuyaStatus tsuya_photograph_camera(const TsuyaPhotograph *photograph, TsuyaCamera *camera, TsuyaError **error);

// Pixels that show the object: width x height bytes, 1 or 0. Null for null.
//
// # Safety
// `photograph` is null or a photograph that was not freed.
const uint8_t *tsuya_photograph_mask(const TsuyaPhotograph *photograph);

// Linear radiance of a component: width x height x 3 numbers, 0 outside the mask. Null for null and where there is no component of this number.
//
// # Safety
// `photograph` is null or a photograph that was not freed.
const float *tsuya_photograph_component(const TsuyaPhotograph *photograph,
                                        uint32_t number);

// Bakes the reflectance into textures, once for each albedo. `white_albedo` is the diffuse albedo of the capture's white board, such as 0.95: colours
// are relative to it. TSUYA_STATUS_ABSENT in a file without reflectance.
//
// # Safety
// `asset` and `error` are null or valid; `textures` can be written to.
TsuyaStatus tsuya_textures(const TsuyaAsset *asset,
                           double white_albedo,
                           TsuyaTextures *textures,
                           TsuyaError **error);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* TSUYA_H */
