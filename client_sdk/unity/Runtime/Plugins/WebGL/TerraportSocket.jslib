// WebSockets for WebGL builds, polled by WebGlTransport.cs: nothing is called back, so no function table is needed. A received
// message waits here until it is taken; how much may wait is bounded by the protocol's credit.
var TerraportSockets = {
  $terraportSockets: { next: 1, open: {} },

  TerraportSocketOpen: function (url, protocols) {
    var names = UTF8ToString(protocols);
    var id = terraportSockets.next++;
    var entry = { socket: null, state: 1, code: 0, reason: "", received: [] };
    terraportSockets.open[id] = entry;
    try {
      entry.socket = names ? new WebSocket(UTF8ToString(url), names.split(",")) : new WebSocket(UTF8ToString(url));
    } catch (error) {
      entry.state = 3;
      entry.code = 1006;
      entry.reason = String(error);
      return id;
    }
    entry.socket.binaryType = "arraybuffer";
    entry.socket.onopen = function () {
      entry.state = 2;
    };
    entry.socket.onmessage = function (event) {
      var isText = typeof event.data === "string";
      var bytes = isText ? new TextEncoder().encode(event.data) : new Uint8Array(event.data);
      entry.received.push({ isText: isText, bytes: bytes });
    };
    entry.socket.onclose = function (event) {
      entry.state = 3;
      entry.code = event.code;
      entry.reason = event.reason;
    };
    return id;
  },
  TerraportSocketOpen__deps: ["$terraportSockets"],

  TerraportSocketState: function (id) {
    var entry = terraportSockets.open[id];
    return entry ? entry.state : 3;
  },
  TerraportSocketState__deps: ["$terraportSockets"],

  TerraportSocketCloseCode: function (id) {
    var entry = terraportSockets.open[id];
    return entry ? entry.code : 1006;
  },
  TerraportSocketCloseCode__deps: ["$terraportSockets"],

  // Text as UTF-8 into the buffer, cut to its size; returns its bytes. 0: the close reason, 1: the subprotocol.
  TerraportSocketText: function (id, which, buffer, capacity) {
    var entry = terraportSockets.open[id];
    var text = !entry ? "" : which === 0 ? entry.reason : entry.socket ? entry.socket.protocol : "";
    var bytes = new TextEncoder().encode(text).subarray(0, capacity);
    HEAPU8.set(bytes, buffer);
    return bytes.length;
  },
  TerraportSocketText__deps: ["$terraportSockets"],

  // Bytes of the next message, or -1.
  TerraportSocketNextLength: function (id) {
    var entry = terraportSockets.open[id];
    return entry && entry.received.length > 0 ? entry.received[0].bytes.length : -1;
  },
  TerraportSocketNextLength__deps: ["$terraportSockets"],

  // Copies the next message and forgets it. Returns 1 for text, 0 for binary.
  TerraportSocketTake: function (id, buffer) {
    var message = terraportSockets.open[id].received.shift();
    HEAPU8.set(message.bytes, buffer);
    return message.isText ? 1 : 0;
  },
  TerraportSocketTake__deps: ["$terraportSockets"],

  // 0: not now. What waits to leave is bounded here, since browsers do not.
  TerraportSocketSend: function (id, buffer, length) {
    var entry = terraportSockets.open[id];
    if (!entry || entry.state !== 2 || entry.socket.bufferedAmount > 1048576) {
      return 0;
    }
    entry.socket.send(HEAPU8.slice(buffer, buffer + length));
    return 1;
  },
  TerraportSocketSend__deps: ["$terraportSockets"],

  TerraportSocketClose: function (id, code, reason) {
    var entry = terraportSockets.open[id];
    if (entry && entry.socket && entry.state !== 3) {
      // Pages may close with 1000 and 3000 to 4999 alone.
      entry.socket.close(code === 1000 || code >= 3000 ? code : 1000, UTF8ToString(reason));
    }
  },
  TerraportSocketClose__deps: ["$terraportSockets"],

  TerraportSocketForget: function (id) {
    delete terraportSockets.open[id];
  },
  TerraportSocketForget__deps: ["$terraportSockets"],
};

mergeInto(LibraryManager.library, TerraportSockets);
