/* Prints what a file holds, and writes the photograph of a view: views FILE.tsuya [VIEW [FOLDER]]. Of each component of reflection
   FOLDER/COMPONENT.pfm has the linear radiance. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tsuya.h>

static const char *const COMPONENTS[] = {"diffuse", "specular", "combined"};

static void fail(const char *what, TsuyaError *error) {
  fprintf(stderr, "%s: %s\n", what, tsuya_error_message(error));
  tsuya_error_free(error);
  exit(1);
}

/* All bytes of a file. */
static uint8_t *read_all(const char *path, size_t *length) {
  FILE *file = fopen(path, "rb");
  if (!file || fseek(file, 0, SEEK_END) || (long)(*length = (size_t)ftell(file)) < 0 || fseek(file, 0, SEEK_SET)) {
    perror(path);
    exit(1);
  }
  uint8_t *bytes = malloc(*length ? *length : 1);
  if (!bytes || fread(bytes, 1, *length, file) != *length) {
    perror(path);
    exit(1);
  }
  fclose(file);
  return bytes;
}

/* A portable float map: rows from the bottom. */
static void write_pfm(const char *path, const float *pixels, uint32_t width, uint32_t height) {
  FILE *file = fopen(path, "wb");
  if (!file) {
    perror(path);
    exit(1);
  }
  fprintf(file, "PF\n%u %u\n-1.0\n", width, height);
  for (uint32_t y = height; y-- > 0;) fwrite(pixels + (size_t)y * width * 3, sizeof(float), (size_t)width * 3, file);
  fclose(file);
}

int main(int count, char **arguments) {
  if (count < 2) {
    fprintf(stderr, "views FILE.tsuya [VIEW [FOLDER]]\n");
    return 2;
  }
  size_t length;
  uint8_t *bytes = read_all(arguments[1], &length);
  /* What a file from anywhere may ask for. */
  TsuyaLimits limits = tsuya_default_limits();
  limits.memory_bytes = (uint64_t)512 << 20;
  TsuyaAsset *asset = NULL;
  TsuyaError *error = NULL;
  if (tsuya_open_memory(bytes, length, &limits, &asset, &error) != TSUYA_STATUS_OK) fail(arguments[1], error);
  free(bytes);

  uint32_t views = tsuya_view_count(asset), components = tsuya_component_count(asset);
  TsuyaMesh mesh;
  if (tsuya_mesh(asset, TSUYA_MESH_KIND_DRAWN, &mesh, &error) != TSUYA_STATUS_OK) fail("mesh", error);
  printf("%u views, %u components, %zu vertices, %zu triangles\n%s\n", views, components, mesh.vertex_count, mesh.triangle_count,
         tsuya_metadata(asset));
  if (views == 0) {
    tsuya_asset_free(asset);
    return 0;
  }

  uint32_t index = count > 2 ? (uint32_t)strtoul(arguments[2], NULL, 10) : 0;
  TsuyaView view;
  if (tsuya_view(asset, index, &view, &error) != TSUYA_STATUS_OK) fail("view", error);
  TsuyaPhotograph *photograph = NULL;
  if (tsuya_decode_view(asset, index, 0, NULL, &photograph, &error) != TSUYA_STATUS_OK) fail(view.name, error);
  uint32_t width = tsuya_photograph_width(photograph), height = tsuya_photograph_height(photograph);
  const uint8_t *mask = tsuya_photograph_mask(photograph);
  size_t shown = 0;
  for (size_t pixel = 0; pixel < (size_t)width * height; pixel++) shown += mask[pixel];
  printf("view %u, %s: %u x %u pixels, %zu of the object\n", index, view.name, width, height, shown);
  for (uint32_t k = 0; k < components && count > 3; k++) {
    TsuyaComponent component;
    if (tsuya_component(asset, k, &component, &error) != TSUYA_STATUS_OK) fail("component", error);
    char path[4096];
    snprintf(path, sizeof path, "%s/%s.pfm", arguments[3], COMPONENTS[component]);
    write_pfm(path, tsuya_photograph_component(photograph, k), width, height);
  }
  tsuya_photograph_free(photograph);
  tsuya_asset_free(asset);
  return 0;
}
