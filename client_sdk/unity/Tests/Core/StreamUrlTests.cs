using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Scene URLs in every form that a user may paste.</summary>
    [TestFixture]
    public class StreamUrlTests
    {
        [TestCase("https://mine.example:8443/tp/scenes/north%20pit", "wss://mine.example:8443/tp/scenes/north%20pit/stream")]
        [TestCase("http://127.0.0.1:8080/scenes/a", "ws://127.0.0.1:8080/scenes/a/stream")]
        [TestCase("ws://localhost/scenes/a/stream", "ws://localhost/scenes/a/stream")]
        [TestCase("WSS://localhost:443/scenes/a/", "wss://localhost/scenes/a/stream")]
        [TestCase("http://[::1]:80/scenes/%C3%A9", "ws://[::1]/scenes/%C3%A9/stream")]
        public void SceneUrlsGiveTheStream(string url, string stream) { Assert.AreEqual(stream, SceneUrl.Parse(url).StreamUrl); }

        [TestCase("http://host:1", "http://host:1")]
        [TestCase("http://host/", "http://host")]
        [TestCase("ws://host/prefix/", "http://host/prefix")]
        [TestCase("https://host/prefix/scenes/", "https://host/prefix")]
        public void ServerUrlsNameNoScene(string url, string server)
        {
            SceneUrl parsed = SceneUrl.Parse(url);
            Assert.AreEqual(server, parsed.Server);
            Assert.IsNull(parsed.Scene);
            Assert.AreEqual("invalid_url", Assert.Throws<TerraportException>(() => parsed.StreamUrl.ToString()).Code);
            Assert.AreEqual(server + "/scenes/p%20q", parsed.With("p q").HttpUrl);
        }

        [TestCase(null)]
        [TestCase("")]
        [TestCase("host/scenes/a")]
        [TestCase("ftp://host/scenes/a")]
        [TestCase("http:///scenes/a")]
        [TestCase("http://host/scenes/a/b")]
        [TestCase("http://host/scenesa")]
        [TestCase("http://me:secret@host/scenes/a")]
        [TestCase("http://host/scenes/a?token=secret")]
        [TestCase("http://host/scenes/a#secret")]
        public void OthersAreRefusedWithoutRepeatingSecrets(string url)
        {
            var error = Assert.Throws<TerraportException>(() => SceneUrl.Parse(url));
            Assert.AreEqual("invalid_url", error.Code);
            Assert.IsFalse(error.Message.Contains("secret"));
        }
    }
}
