// Smooth edges where the quality of the picture asks for them. Multisampling of a canvas can never be turned off, and
// without a graphics card it takes half the time of a frame; that of a texture, copied to the canvas, can (WebGL 2).

class Multisampling {
  constructor(renderer) {
    this.renderer = renderer;
    // With a stencil three.js takes a depth buffer of 24 bits, without one of 16.
    this.target = new THREE.WebGLMultisampleRenderTarget(1, 1, {
      stencilBuffer: true, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter, encoding: renderer.outputEncoding,
    });
    this.copy = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), new THREE.ShaderMaterial({
      depthTest: false, depthWrite: false, blending: THREE.NoBlending,
      uniforms: { picture: { value: this.target.texture } },
      vertexShader: "varying vec2 place; void main() { place = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }",
      fragmentShader: "varying vec2 place; uniform sampler2D picture; void main() { gl_FragColor = texture2D(picture, place); }",
    }));
    this.copy.frustumCulled = false;
    this.lens = new THREE.Camera();
  }

  /** Draws what paint() renders, with four samples per pixel. */
  draw(paint) {
    const { renderer, target } = this, size = renderer.getDrawingBufferSize(new THREE.Vector2());
    target.setSize(size.x, size.y);
    // Limited to the same part of the window as the canvas.
    renderer.getScissor(target.scissor).multiplyScalar(renderer.getPixelRatio()).floor();
    target.scissorTest = renderer.getScissorTest();
    renderer.setRenderTarget(target);
    paint();
    renderer.setRenderTarget(null);
    renderer.render(this.copy, this.lens);
  }
}
