export { AmbientLight, BoxGeometry, BufferGeometry, Color, CylinderGeometry, DirectionalLight, Euler, Float32BufferAttribute, GridHelper, Group, HemisphereLight, Mesh, MeshLambertMaterial, MeshBasicMaterial, PerspectiveCamera, Quaternion, Scene, SphereGeometry, Vector3, WebGLRenderer, Box3, ConeGeometry } from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
