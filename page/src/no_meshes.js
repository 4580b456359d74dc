// Replaces three's mesh loaders, which urdf-loader would pull in: no mesh is served.

export class STLLoader {}
export class ColladaLoader {}
