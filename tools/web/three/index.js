// tsuya's measured appearances in three.js (WebGLRenderer).

export { ALL_LAYERS, Appearance } from "./appearance.js";
export { ENVIRONMENTS, environmentOfLobes, environmentOfPicture } from "./environment.js";
export { AppearanceError, EXTENSION, TsuyaAppearance } from "./loader.js";
