// A scene in CesiumJS, without a client of ours: the service is a tileset of 3D Tiles 1.1 (docs/topics/tiles.md). `npm i cesium`
// in this folder, then serve it by any web server.
const { Cesium } = window;

const sceneUrl = new URLSearchParams(location.search).get("scene") ?? "http://127.0.0.1:8080/scenes/sample";
const widget = new Cesium.CesiumWidget("globe", { baseLayer: false, skyBox: false, skyAtmosphere: false });
widget.scene.globe.show = false; // No imagery, no terrain: nothing is loaded from elsewhere.
widget.scene.backgroundColor = Cesium.Color.fromCssColorString("#b9cdd8");

// Where the service asks for a token: new Cesium.Resource({ url, headers: { Authorization: `Bearer ${token}` } }).
const tileset = await Cesium.Cesium3DTileset.fromUrl(`${sceneUrl}/tileset.json`, { maximumScreenSpaceError: 4 });
widget.scene.primitives.add(tileset);
await widget.zoomTo(tileset, new Cesium.HeadingPitchRange(0, -0.6, tileset.boundingSphere.radius));
Object.assign(window, { tileset, widget }); // To look at from the console.
