//! Profile `paper`: the Wavelet-Texture method of Miyazaki, Shibata and Ikeuchi (2007) as a real bitstream.
pub(crate) mod parallel;
