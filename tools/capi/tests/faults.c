/* What a program may do wrong, and what may be wrong with a file: each is an error that says what. faults FILE.tsuya */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tsuya.h>

static unsigned tried = 0;

/* Expects a status, and a message where it is none of success. */
static void expect(TsuyaStatus expected, TsuyaStatus found, TsuyaError *error, const char *what) {
  const char *message = tsuya_error_message(error);
  tried++;
  if (found != expected || (found != TSUYA_STATUS_OK) != (strlen(message) > 0)) {
    fprintf(stderr, "%s: status %d in place of %d, '%s'\n", what, (int)found, (int)expected, message);
    exit(1);
  }
  tsuya_error_free(error);
}

/* Calls, with an error of its own. */
#define EXPECT(expected, call)                                 \
  do {                                                         \
    TsuyaError *error = NULL;                                  \
    TsuyaStatus found = call;                                  \
    expect(expected, found, error, #call);                     \
  } while (0)

int main(int count, char **arguments) {
  if (count != 2) return 2;
  FILE *file = fopen(arguments[1], "rb");
  if (!file) return 2;
  static uint8_t bytes[1 << 20], damaged[1 << 20];
  size_t length = fread(bytes, 1, sizeof bytes, file);
  fclose(file);
  TsuyaAsset *asset = NULL, *other = NULL;

  EXPECT(TSUYA_STATUS_OK, tsuya_open_memory(bytes, length, NULL, &asset, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_open_memory(NULL, length, NULL, &other, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_open_memory(bytes, length, NULL, NULL, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_open_file(NULL, NULL, &other, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_open_file("\xff\xfe", NULL, &other, &error));
  EXPECT(TSUYA_STATUS_IO, tsuya_open_file("/nowhere/at/all.tsuya", NULL, &other, &error));
  EXPECT(TSUYA_STATUS_FORMAT, tsuya_open_memory(bytes, 0, NULL, &other, &error));
  TsuyaLimits limits = tsuya_default_limits();
  limits.memory_bytes = 1000;
  EXPECT(TSUYA_STATUS_LIMITS, tsuya_open_memory(bytes, length, &limits, &other, &error));
  /* Without a place for the error. */
  if (tsuya_open_memory(bytes, 100, NULL, &other, NULL) != TSUYA_STATUS_FORMAT) return 1;

  TsuyaView view;
  TsuyaMesh mesh;
  TsuyaTextures textures;
  TsuyaComponent component;
  TsuyaCamera camera;
  TsuyaPhotograph *photograph = NULL;
  double white[3];
  TsuyaRegion outside = {0, 0, 100000, 1}, none = {3, 3, 0, 0};
  uint32_t views = tsuya_view_count(asset);
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_view(asset, views, &view, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_view(NULL, 0, &view, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_view(asset, 0, NULL, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_component(asset, 9, &component, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_white(asset, NULL, &error));
  EXPECT(TSUYA_STATUS_OK, tsuya_white(asset, white, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_mesh(asset, 77, &mesh, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_mesh(asset, TSUYA_MESH_KIND_DRAWN, NULL, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_textures(asset, -1.0, &textures, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_textures(asset, 0.0 / 0.0, &textures, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_decode_view(asset, views, 0, NULL, &photograph, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_decode_view(asset, 0, 200, NULL, &photograph, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_decode_view(asset, 0, 0, &outside, &photograph, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_decode_view(asset, 0, 0, &none, &photograph, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_decode_view(asset, 0, 0, NULL, NULL, &error));
  EXPECT(TSUYA_STATUS_PARAMETER, tsuya_photograph_camera(NULL, &camera, &error));

  /* Twice is once more, and the same. */
  TsuyaTextures again, brighter;
  EXPECT(TSUYA_STATUS_OK, tsuya_textures(asset, 0.5, &textures, &error));
  EXPECT(TSUYA_STATUS_OK, tsuya_textures(asset, 0.95, &brighter, &error));
  EXPECT(TSUYA_STATUS_OK, tsuya_textures(asset, 0.5, &again, &error));
  if (textures.base_colour.texels != again.base_colour.texels || textures.base_colour.texels == brighter.base_colour.texels) return 1;

  /* A photograph outlives its asset, and a part is a part of the whole. */
  TsuyaPhotograph *part = NULL;
  TsuyaRegion region = {5, 7, 16, 8};
  EXPECT(TSUYA_STATUS_OK, tsuya_decode_view(asset, 1, 0, NULL, &photograph, &error));
  EXPECT(TSUYA_STATUS_OK, tsuya_decode_view(asset, 1, 0, &region, &part, &error));
  tsuya_asset_free(asset);
  const float *whole = tsuya_photograph_component(photograph, 0), *cut = tsuya_photograph_component(part, 0);
  for (uint32_t y = 0; y < region.height; y++) {
    const float *row = whole + ((size_t)(region.top + y) * tsuya_photograph_width(photograph) + region.left) * 3;
    if (memcmp(row, cut + (size_t)y * region.width * 3, region.width * 3 * sizeof(float)) != 0) return 1;
  }
  if (tsuya_photograph_component(photograph, 5) != NULL) return 1;
  EXPECT(TSUYA_STATUS_OK, tsuya_photograph_camera(part, &camera, &error));
  if (camera.width != region.width || camera.height != region.height) return 1;
  tsuya_photograph_free(photograph);
  tsuya_photograph_free(part);

  /* Cut off and damaged anywhere: an error, or what checksums prove. */
  for (size_t at = 1; at < length; at += length / 97 + 1) {
    TsuyaError *error = NULL;
    TsuyaStatus status = tsuya_open_memory(bytes, at, NULL, &other, &error);
    if (status == TSUYA_STATUS_OK) return 1;
    expect(TSUYA_STATUS_FORMAT, status, error, "cut off");
    memcpy(damaged, bytes, length);
    damaged[at] ^= 0x40;
    error = NULL;
    other = NULL;
    if (tsuya_open_memory(damaged, length, NULL, &other, &error) == TSUYA_STATUS_OK) {
      photograph = NULL;
      TsuyaError *later = NULL;
      if (tsuya_decode_view(other, 0, 0, NULL, &photograph, &later) != TSUYA_STATUS_OK && strlen(tsuya_error_message(later)) == 0) return 1;
      tsuya_photograph_free(photograph);
      tsuya_error_free(later);
      tsuya_asset_free(other);
    } else if (strlen(tsuya_error_message(error)) == 0) {
      return 1;
    }
    tsuya_error_free(error);
    tried += 2;
  }
  tsuya_asset_free(NULL);
  tsuya_photograph_free(NULL);
  tsuya_error_free(NULL);
  printf("%u faults, each with its error\n", tried);
  return 0;
}
