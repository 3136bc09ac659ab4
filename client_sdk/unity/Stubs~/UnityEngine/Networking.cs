using System;

namespace UnityEngine
{
    public class AsyncOperation
    {
        public event Action<AsyncOperation> completed;

        internal void Complete()
        {
            if (completed != null)
            {
                completed(this);
            }
        }
    }
}

namespace UnityEngine.Networking
{
    public class DownloadHandler
    {
    }

    public class DownloadHandlerScript : DownloadHandler
    {
        public DownloadHandlerScript(byte[] preallocatedBuffer) {}

        protected virtual bool ReceiveData(byte[] data, int dataLength) { return true; }
    }

    public class UnityWebRequestAsyncOperation : AsyncOperation
    {
    }

    public class UnityWebRequest : IDisposable
    {
        public const string kHttpVerbGET = "GET";

        public UnityWebRequest(string url, string method) {}

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
