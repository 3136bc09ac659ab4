// Run in a page before its own scripts: counts every call of WebGL, in `glCalls`.
(() => {
  window.glCalls = 0;
  const count = (owner, name) => {
    const inner = owner[name];
    owner[name] = function (...args) {
      window.glCalls += 1;
      return inner.apply(this, args);
    };
  };
  const proto = WebGL2RenderingContext.prototype;
  for (const name of Object.getOwnPropertyNames(proto)) {
    if (typeof Object.getOwnPropertyDescriptor(proto, name).value === "function") count(proto, name);
  }
  const watched = new WeakSet();
  const ask = proto.getExtension;
  proto.getExtension = function (name) {
    const extension = ask.call(this, name);
    if (name === "WEBGL_multi_draw" && extension && !watched.has(extension)) {
      watched.add(extension);
      count(extension, "multiDrawElementsWEBGL");
    }
    return extension;
  };
})();
