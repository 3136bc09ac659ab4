document.querySelector("#app")?.append("terraport");
