/** Numbers with a place in space. */

export type Vec3 = readonly [number, number, number];
/** Unit quaternion, real part first. */
export type Quaternion = readonly [number, number, number, number];
