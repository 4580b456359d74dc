// In place of three's loaders of meshes, which urdf-loader would bring along: no mesh is served.

export class STLLoader {}
export class ColladaLoader {}
