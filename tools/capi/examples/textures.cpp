// Writes a textured mesh as other engines take it: textures FILE.tsuya FOLDER makes mesh.obj, and base-colour.ppm, roughness-metalness.ppm, specular.ppm
// and normal.ppm, as far as the file has them.

#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <tsuya.h>

struct Free {
  void operator()(TsuyaAsset *asset) const { tsuya_asset_free(asset); }
  void operator()(TsuyaError *error) const { tsuya_error_free(error); }
};

// Calls a function of the library whose last argument is an error; what it says is thrown.
template <typename Function, typename... Arguments>
void call(Function function, Arguments... arguments) {
  TsuyaError *error = nullptr;
  if (function(arguments..., &error) != TSUYA_STATUS_OK) {
    std::unique_ptr<TsuyaError, Free> owned(error);
    throw std::runtime_error(tsuya_error_message(error));
  }
}

static void write_texture(const std::string &path, const TsuyaTexture &texture) {
  if (texture.texels == nullptr) return;
  std::ofstream file(path, std::ios::binary);
  file << "P6 " << texture.width << " " << texture.height << " 255\n";
  file.write(reinterpret_cast<const char *>(texture.texels), std::streamsize(texture.width) * texture.height * 3);
  if (!file) throw std::runtime_error(path + " can't be written");
}

static void write_mesh(const std::string &path, const TsuyaMesh &mesh) {
  std::ofstream file(path);
  file.precision(9);
  for (size_t v = 0; v < mesh.vertex_count; v++) {
    const float *p = mesh.positions + 3 * v, *n = mesh.normals + 3 * v, *t = mesh.texture_coordinates + 2 * v;
    file << "v " << p[0] << " " << p[1] << " " << p[2] << "\nvn " << n[0] << " " << n[1] << " " << n[2] << "\nvt " << t[0] << " "
         << 1 - t[1] << "\n";
  }
  for (size_t t = 0; t < mesh.triangle_count; t++) {
    file << "f";
    for (int k = 0; k < 3; k++) {
      uint32_t v = mesh.triangles[3 * t + k] + 1;
      file << " " << v << "/" << v << "/" << v;
    }
    file << "\n";
  }
  if (!file) throw std::runtime_error(path + " can't be written");
}

int main(int count, char **arguments) try {
  if (count != 3) {
    std::cerr << "textures FILE.tsuya FOLDER\n";
    return 2;
  }
  TsuyaAsset *opened = nullptr;
  call(tsuya_open_file, arguments[1], static_cast<const TsuyaLimits *>(nullptr), &opened);
  std::unique_ptr<TsuyaAsset, Free> asset(opened);
  const std::string folder = arguments[2];
  TsuyaMesh mesh;
  TsuyaTextures textures;
  call(tsuya_mesh, asset.get(), uint32_t(TSUYA_MESH_KIND_TEXTURED), &mesh);
  call(tsuya_textures, asset.get(), 0.95, &textures);
  write_mesh(folder + "/mesh.obj", mesh);
  write_texture(folder + "/base-colour.ppm", textures.base_colour);
  write_texture(folder + "/roughness-metalness.ppm", textures.metallic_roughness);
  write_texture(folder + "/specular.ppm", textures.specular_colour);
  write_texture(folder + "/normal.ppm", textures.normal);
  std::cout << mesh.triangle_count << " triangles, textures of " << textures.base_colour.width << " x " << textures.base_colour.height
            << "\n";
} catch (const std::exception &error) {
  std::cerr << error.what() << "\n";
  return 1;
}
