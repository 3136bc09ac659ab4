using System;

namespace UnityEngine
{
    public class AsyncOperation
    {
        public event Action<AsyncOperation> completed;
        internal void Complete() { completed?.Invoke(this); }
    }
}

namespace UnityEngine.Networking
{
    public class DownloadHandler
    {
        public byte[] data => null;
    }

    public class UnityWebRequestAsyncOperation : AsyncOperation
    {
    }

    public class UnityWebRequest : IDisposable
    {
        public static UnityWebRequest Get(string uri) { return new UnityWebRequest(); }
        public DownloadHandler downloadHandler { get; set; }
        public int redirectLimit { get; set; }
        public long responseCode { get; private set; }
        public string error { get; private set; }
        public void SetRequestHeader(string name, string value) {}
        public UnityWebRequestAsyncOperation SendWebRequest() { return new UnityWebRequestAsyncOperation(); }
        public void Abort() {}
        public void Dispose() {}
    }
}
