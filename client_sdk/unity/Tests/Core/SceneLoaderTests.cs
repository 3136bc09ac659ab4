using System;
using System.Collections.Generic;
using System.IO;
using System.Text;
using System.Threading;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>What is loaded once for a scene, from the corpus's small scenes.</summary>
    [TestFixture]
    public class SceneLoaderTests
    {
        private const string Url = "http://server/scenes/tiny";

        [TestCase("tiny", false, true, false)]
        [TestCase("tiny-textured", true, false, false)]
        [TestCase("tiny-base-image", true, true, true)]
        [TestCase("tiny-changed", false, true, false)]
        public void Scene_IsLoadedWhole(string name, bool hasTexture, bool hasColour, bool ofPoints)
        {
            long receivedBytes = 0;
            long totalBytes = 0;
            Action<long, long> onProgress = (received, announced) =>
            {
                Assert.GreaterOrEqual(received, receivedBytes);
                receivedBytes = received;
                totalBytes = announced;
            };
            SceneFiles files = SceneLoader.LoadAsync(Url, null, Http(name), onProgress).Result;
            Assert.AreEqual(4, files.Manifest.SegmentCount);
            Assert.AreEqual(files.Manifest.BaseFaces, files.Base.FaceCount);
            Assert.AreEqual(files.Base.FaceCount + 1, files.Cover.Offsets.Length);
            Assert.AreEqual(hasTexture, files.Base.HasTexture);
            Assert.AreEqual(hasTexture, !files.Base.HasColours);
            Assert.AreEqual(hasColour, files.Manifest.HasColour);
            Assert.AreEqual(ofPoints, files.Manifest.TexturesOfPoints);
            Assert.Greater(files.Regions.Count, 0);
            Assert.Greater(totalBytes, 0);
            Assert.AreEqual(totalBytes, receivedBytes);
        }

        [Test]
        public void Labels_StandBeforeTheBuildsOwn()
        {
            SceneFiles files = SceneLoader.LoadAsync(Url, null, Http("tiny")).Result;
            string text = File.ReadAllText(Repository.PathTo("tests/conformance/scene/tiny/labels.json"));
            int labelled = 0;
            foreach (RegionFacts region in files.Regions)
            {
                labelled += region.Label != null && text.Contains(region.Label) ? 1 : 0;
            }
            Assert.Greater(labelled, 0);
        }

        [Test]
        public void ServerUrl_StandsForItsOnlyScene()
        {
            Assert.AreEqual("tiny", SceneLoader.LoadAsync("ws://server", null, Http("tiny")).Result.Manifest.Id);
        }

        [Test]
        public void Files_AreAskedForByTheirVersion()
        {
            FolderHttp http = Http("tiny");
            SceneFiles files = SceneLoader.LoadAsync(Url, null, http).Result;
            Assert.IsTrue(http.Urls.Contains(Url + "/base.glb?v=" + files.Manifest.Version));
        }

        [TestCase("base.glb")]
        [TestCase("base.cover")]
        [TestCase("regions.json")]
        public void Damage_IsNoticedByTheHash(string name)
        {
            FolderHttp http = Http("tiny");
            http.Damaged = name;
            Assert.AreEqual("damaged", Failure(Url, null, http).Code);
        }

        [Test]
        public void Token_IsAskedFor()
        {
            FolderHttp http = Http("tiny");
            http.Token = "right";
            TerraportException error = Failure(Url, "wrong", http);
            Assert.AreEqual("unauthorised", error.Code);
            Assert.AreEqual(401, error.CloseCode);
            Assert.IsTrue(error.Message.StartsWith("no such token"));
            Assert.IsNotNull(SceneLoader.LoadAsync(Url, "right", http).Result);
        }

        [Test]
        public void Scene_ThatIsNotThere_IsNamedSo()
        {
            Assert.AreEqual("unknown_scene", Failure("http://server/scenes/other", null, Http("tiny")).Code);
        }

        [Test]
        public void Cancelled_Ends()
        {
            var cancel = new CancellationTokenSource();
            cancel.Cancel();
            var error = Assert.Throws<AggregateException>(() => SceneLoader.LoadAsync(Url, null, Http("tiny"), null, cancel.Token).Wait());
            Assert.IsInstanceOf<OperationCanceledException>(error.InnerException);
        }

        [TestCase("\"format_version\"", "\"format_version\":\"2.0\",\"x\"", "unsupported_version")]
        [TestCase("\"format\"", "\"format\":\"other\",\"x\"", "damaged")]
        [TestCase("\"step_m\"", "\"step_m\":0.3,\"x\"", "damaged")]
        [TestCase("\"segments\"", "\"segments\":0,\"x\"", "damaged")]
        [TestCase("\"deviation_m\"", "\"deviation_m\":-1,\"x\"", "damaged")]
        [TestCase("\"origin\"", "\"origin\":[1,2],\"x\"", "damaged")]
        [TestCase("\"has_colour\"", "\"has_colour\":1,\"x\"", "damaged")]
        [TestCase("\"segment-2\"", "\"x\"", "damaged")]
        [TestCase("\"counts\"", "\"levels\":3,\"counts\"", "damaged")]
        [TestCase("\"counts\"", "\"levels\":0,\"counts\"", "damaged")]
        public void Manifest_OutsideTheFormat_IsRefused(string from, string to, string code)
        {
            string text = File.ReadAllText(Repository.PathTo("tests/conformance/scene/tiny/scene.json"));
            // Pretty or not: keys are followed by a colon.
            text = text.Replace(from + ":", to + ":").Replace(from + " :", to + ":");
            var error =
                Assert.Throws<TerraportException>(() => ManifestReader.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(text)), "tiny"));
            Assert.AreEqual(code, error.Code, error.Message);
        }

        [Test]
        public void Levels_AreOneWhereNothingIsSaid()
        {
            string text = File.ReadAllText(Repository.PathTo("tests/conformance/scene/tiny/scene.json"));
            Assert.AreEqual(1, ManifestReader.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(text)), "tiny").Levels);
            text = text.Replace("\"counts\":", "\"levels\": 2, \"counts\":");
            Assert.AreEqual(2, ManifestReader.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(text)), "tiny").Levels);
        }

        [Test]
        public void Survey_ThereAndBack()
        {
            SceneManifest manifest = SceneLoader.LoadAsync(Url, null, Http("tiny")).Result.Manifest;
            double east, north, height;
            manifest.ToSurvey(new Vec3(1, 2, 3), out east, out north, out height);
            Assert.AreEqual(manifest.OriginEast + 1, east);
            Assert.AreEqual(manifest.OriginNorth - 3, north);
            Assert.AreEqual(manifest.OriginHeight + 2, height);
            Assert.AreEqual(new Vec3(1, 2, 3), manifest.FromSurvey(east, north, height));
        }

        [Test]
        public void Cover_EveryFlippedBitIsNoticed()
        {
            int faces = SceneLoader.LoadAsync(Url, null, Http("tiny")).Result.Base.FaceCount;
            string folder = Repository.PathTo("tests/conformance/scene/tiny");
            byte[] whole = File.ReadAllBytes(Directory.GetFiles(folder, "base.cover", SearchOption.AllDirectories)[0]);
            for (int at = 0; at < whole.Length; at++)
            {
                // Flip, read, flip back.
                whole[at] ^= 1;
                Assert.Throws<PayloadException>(() => CoverReader.Read(new ArraySegment<byte>(whole), faces, 4), "byte " + at);
                whole[at] ^= 1;
            }
            CoverReader.Read(new ArraySegment<byte>(whole), faces, 4);
        }

        [Test]
        public void Cover_OutsideTheScene_IsRefused()
        {
            SceneFiles files = SceneLoader.LoadAsync(Url, null, Http("tiny")).Result;
            string folder = Repository.PathTo("tests/conformance/scene/tiny");
            string path = Directory.GetFiles(folder, "base.cover", SearchOption.AllDirectories)[0];
            var bytes = new ArraySegment<byte>(File.ReadAllBytes(path));
            int faces = files.Base.FaceCount;
            Assert.AreEqual(files.Cover.Segments, CoverReader.Read(bytes, faces, 4).Segments);
            Assert.Throws<PayloadException>(() => CoverReader.Read(bytes, faces + 1, 4));
            Assert.Throws<PayloadException>(() => CoverReader.Read(bytes, faces, 3));
            Assert.Throws<PayloadException>(() => CoverReader.Read(new ArraySegment<byte>(bytes.Array, 0, bytes.Count - 8), faces, 4));
        }

        private static FolderHttp Http(string scene) { return new FolderHttp(Repository.PathTo("tests/conformance/scene/" + scene)); }

        private static TerraportException Failure(string url, string token, IHttp http)
        {
            var error = Assert.Throws<AggregateException>(() => SceneLoader.LoadAsync(url, token, http).Wait());
            return (TerraportException)error.InnerException;
        }
    }
}
